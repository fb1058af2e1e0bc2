//! How a protected packet is divided into layers, so that what arrives is worth most.

use crate::modem::error::ModemError;
use crate::modem::limits::{MAX_MTU, MAX_SHARES, MIN_CHECKED_MTU};
use crate::modem::wire::contents::{Layer, MAX_LAYERS, contents_len};
use crate::modem::wire::share::{MAX_FIRST, header_len, number_len};

use super::loss::Loss;

/// What a protected packet may cost, and what the link does to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SharingOptions {
    /// Most bytes of a modem frame, 16 to 65,535.
    pub mtu: usize,
    /// What each modem frame costs on the link beside its bytes: preamble and the modem's own header, as bytes.
    pub overhead: usize,
    /// Bytes for all shares of the packet together, their headers and the overhead counted.
    pub budget: usize,
    /// Most shares, 1 to 256.
    pub max_shares: usize,
    /// Bytes that the link carries between the first share of the packet and its last one, if other packets' shares lie
    /// between them; 0: they follow each other.
    pub spread: usize,
    /// What is lost on the way. If it is not known, 0.1 is a fair guess.
    pub loss: Loss,
    /// Bytes of the packet that make a picture: those before its residual part.
    pub picture: usize,
    /// Length of the packet, if it is known. No layer goes beyond it. What is left of the budget protects it better.
    pub packet: Option<usize>,
    /// No division cuts the packet off. The end of a packet that is cut off is sent to no avail, and later frames
    /// cannot be predicted from its frame.
    pub whole: bool,
    /// User bytes that travel with the packet, at most 255.
    pub user: Option<usize>,
}

/// How a protected packet is divided: the layers, and into how many shares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sharing {
    layers: [Layer; MAX_LAYERS],
    others: usize,
    count: usize,
    /// Bytes of the first layer that are not the packet's.
    head: usize,
    worth: f64,
}

/// Worth of a picture beside what is shown without it, dB: the last one, or the prior at a pose between others.
const PICTURE: f64 = 1.0;
/// Worth of each doubling of a residual, dB, and the bytes from which it counts. They fit what a steady packet's
/// residual takes on a well-mapped site: 50, 104 and 274 bytes for 5.3, 6.3 and 7.3 dB (docs/mapping.md).
const DOUBLING: f64 = 0.85;
const KNEE: f64 = 0.7;

/// Worth of the first bytes of a residual of `all` bytes, dB. The start of a difference picture that was coded finely
/// is worth less than a coarse one of as many bytes: its worth grows about evenly with its length.
fn worth(bytes: f64, all: f64) -> f64 {
    let whole = DOUBLING * (1.0 + all / KNEE).log2();
    PICTURE + if all > 0.0 { whole * bytes / all } else { 0.0 }
}

impl SharingOptions {
    /// # Errors
    /// With the name of what is wrong.
    pub fn check(&self) -> Result<(), ModemError> {
        self.loss.check()?;
        if !(MIN_CHECKED_MTU..=MAX_MTU).contains(&self.mtu) {
            return Err(ModemError::ShareMtu(self.mtu));
        }
        if !(1..=MAX_SHARES).contains(&self.max_shares) {
            return Err(ModemError::ShareCount(self.max_shares));
        }
        match self.user {
            Some(user) if user > 255 => Err(ModemError::UserBytes(user)),
            _ => Ok(()),
        }
    }
}

impl Sharing {
    /// The division of greatest expected worth, of those into a layer that holds the picture and one that holds the
    /// residual, or one that holds both. It looks at every number of shares and at all thresholds.
    ///
    /// # Errors
    /// If an option is outside its range, or the budget holds no picture, or not the whole packet if it must:
    /// [`ModemError::Budget`].
    pub fn new(options: &SharingOptions) -> Result<Sharing, ModemError> {
        options.check()?;
        let fewest = options.budget.div_ceil(options.mtu.saturating_add(options.overhead)).max(1);
        let counts = fewest.min(options.max_shares)..=options.max_shares;
        let best = counts.filter_map(|count| Draft::best(options, count));
        let best = best.max_by(|a, b| a.worth.total_cmp(&b.worth));
        best.ok_or(ModemError::Budget { budget: options.budget, picture: options.picture })
    }

    /// Mean worth of what arrives, about dB.
    pub fn worth(&self) -> f64 {
        self.worth
    }

    /// The same, from the chances that 0, 1, … shares arrive.
    pub fn expect(&self, options: &SharingOptions, chances: &[f64]) -> f64 {
        let packet = options.packet.unwrap_or(usize::MAX);
        let beyond = |bytes: usize| bytes.min(packet).checked_sub(options.picture);
        let all = beyond(self.capacity()).unwrap_or(0) as f64;
        let of = |arrived| match beyond(self.prefix(arrived)) {
            Some(bytes) if arrived >= self.layers[0].threshold => worth(bytes as f64, all),
            _ => 0.0,
        };
        chances.iter().enumerate().map(|(arrived, chance)| chance * of(arrived)).sum()
    }

    /// The layers, first one first.
    pub fn layers(&self) -> &[Layer] {
        &self.layers[..=self.others]
    }

    /// Shares.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Bytes of a packet that all shares together hold.
    pub fn capacity(&self) -> usize {
        self.layers().iter().map(Layer::len).sum::<usize>() - self.head
    }

    /// Bytes of the first layer that are not the packet's.
    pub fn head(&self) -> usize {
        self.head
    }

    /// Bytes of a packet that any `arrived` shares yield.
    pub fn prefix(&self, arrived: usize) -> usize {
        let there = self.layers().iter().filter(|layer| layer.threshold <= arrived);
        there.map(Layer::len).sum::<usize>().saturating_sub(self.head)
    }

    /// Bytes of a share.
    pub fn share_len(&self) -> usize {
        let chunk = self.layers[0].chunk;
        let others = self.layers[1..=self.others].iter().map(|layer| layer.chunk).sum();
        header_len(self.count, chunk, others) + chunk + others
    }
}

/// What a division is made from.
struct Draft<'a> {
    options: &'a SharingOptions,
    count: usize,
    /// Bytes of data in a share.
    data: usize,
}

impl Draft<'_> {
    /// The best division for a number of shares.
    fn best(options: &SharingOptions, count: usize) -> Option<Sharing> {
        let share = (options.budget / count).checked_sub(options.overhead)?.min(options.mtu);
        let data = share.checked_sub(header_len(count, share, share))?;
        let apart =
            options.spread as f64 / ((share + options.overhead) * (count - 1).max(1)) as f64;
        let chances = options.loss.spaced(apart).arrivals(count);
        let draft = Draft { options, count, data };
        let thresholds = (1..=count.min(MAX_FIRST))
            .flat_map(|first| (first..=count).map(move |other| (first, other)));
        let needed = options.packet.filter(|_| options.whole).unwrap_or(0);
        let divisions = thresholds.filter_map(|(first, other)| {
            let mut sharing = draft.divide(first, other)?;
            if sharing.capacity() < needed {
                return None;
            }
            sharing.worth = sharing.expect(options, &chances);
            Some(sharing)
        });
        divisions.max_by(|a, b| a.worth.total_cmp(&b.worth))
    }

    /// The division whose picture needs `first` shares, and whose residual `other`. `None`: there is no room for the
    /// picture.
    fn divide(&self, first: usize, other: usize) -> Option<Sharing> {
        let one = first == other;
        let start = self.options.picture + described(self.options, usize::from(!one), self.count);
        let chunk = start.div_ceil(first);
        let left = self.data.checked_sub(chunk)?;
        let mut layers = [Layer::default(); MAX_LAYERS];
        layers[0] = Layer { threshold: first, chunk };
        layers[1] = Layer { threshold: other, chunk: 0 };
        let others = usize::from(!one);
        let mut sharing = Sharing { layers, others, count: self.count, head: 0, worth: 0.0 };
        sharing.extend(left, self.options);
        Some(sharing)
    }
}

impl Sharing {
    /// Lets the last layer have what rounding left, as far as the packet needs it; drops what no packet fills.
    fn extend(&mut self, left: usize, options: &SharingOptions) {
        self.layers[self.others].chunk += left;
        let head = |layers: &[Layer]| contents_len(layers, options.user);
        loop {
            self.head = head(&self.layers[1..=self.others]);
            let spare = options.packet.map_or(0, |packet| self.capacity().saturating_sub(packet));
            let min = usize::from(self.others == 0);
            let last = &mut self.layers[self.others];
            last.chunk = (last.chunk - (spare / last.threshold).min(last.chunk)).max(min);
            if last.chunk > 0 {
                // A shorter chunk takes fewer bytes to state.
                self.head = head(&self.layers[1..=self.others]);
                return;
            }
            self.others -= 1;
        }
    }
}

/// Most bytes of the first layer that are not the packet's.
fn described(options: &SharingOptions, others: usize, count: usize) -> usize {
    let layer = number_len(count) + number_len(options.mtu);
    1 + layer * others + options.user.map_or(0, |user| 1 + user)
}
