//! How a packet is divided into layers, so that what arrives is worth most.

use super::super::ModemError;
use super::chain::Loss;
use super::header::{LARGEST_FIRST, LONGEST, MAX_SHARES, header_len};
use super::packet::{MAX_LAYERS, contents_len};

/// A layer of a packet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Layer {
    /// Shares that give the layer.
    pub threshold: usize,
    /// Bytes of it in each share.
    pub chunk: usize,
}

impl Layer {
    /// Bytes of the layer.
    pub fn len(&self) -> usize {
        self.threshold * self.chunk
    }

    /// Whether the layer is empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// What a packet may cost, and what the link does to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SharingOptions {
    /// Most bytes of a modem frame, 16 to 65,535.
    pub mtu: usize,
    /// What each modem frame costs on the link beside its bytes: preamble and the modem's own header, as bytes.
    pub overhead: usize,
    /// Bytes for all shares of the packet together, their headers and the overhead counted.
    pub budget: usize,
    /// Most shares, 1 to 256.
    pub most: usize,
    /// What is lost on the way. If it is not known, 0.1 is a fair guess.
    pub loss: Loss,
    /// Bytes of the packet that make a picture: its latent part and, if there is one, its camera part.
    pub picture: usize,
    /// Length of the packet, if it is known. No layer goes beyond it. What is left of the budget protects it better.
    pub packet: Option<usize>,
    /// User bytes that travel with the packet, at most 255.
    pub user: Option<usize>,
}

/// How a packet is divided: the layers, and into how many shares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sharing {
    layers: [Layer; MAX_LAYERS],
    others: usize,
    count: usize,
    /// Bytes of the first layer that are not the packet's.
    head: usize,
}

/// Least MTU that shares are made for, bytes.
const SMALLEST_MTU: usize = 16;
/// Worth of a picture beside that of the last one held, in the unit of [`worth`]: some dB.
const PICTURE: f64 = 8.0;
/// Bytes of a residual up to which each counts as much as the one before, and from which as many more are as much
/// better: what a steady packet takes before the picture gains from it.
const KNEE: f64 = 3.0;
/// Fewest bytes of a layer, per share of its threshold. Smaller ones do not pay for their description.
const LEAST_CHUNK: f64 = 2.0;

/// Worth of the first bytes of a packet in dB, `bytes` beyond what makes a picture. Each doubling of the residual is worth
/// 1.2 dB, as the wavelet coder's bytes at 31 to 33 dB show (docs/mapping.md).
fn worth(bytes: f64) -> f64 {
    PICTURE + 1.2 * (1.0 + bytes / KNEE).log2()
}

impl SharingOptions {
    /// # Errors
    /// With the name of what is wrong.
    fn check(&self) -> Result<(), ModemError> {
        self.loss.check()?;
        if !(SMALLEST_MTU..=super::super::layout::LARGEST_MTU).contains(&self.mtu) {
            return Err(ModemError::ShareMtu(self.mtu));
        }
        if !(1..=MAX_SHARES).contains(&self.most) {
            return Err(ModemError::ShareCount(self.most));
        }
        match self.user {
            Some(user) if user > 255 => Err(ModemError::UserBytes(user)),
            _ => Ok(()),
        }
    }
}

impl Sharing {
    /// The division of greatest expected worth. It looks at every number of shares and at every threshold of the picture.
    ///
    /// # Errors
    /// If an option is outside its range, or the budget holds no picture: [`ModemError::Budget`] says what would.
    pub fn new(options: &SharingOptions) -> Result<Sharing, ModemError> {
        options.check()?;
        let fewest = options.budget.div_ceil(options.mtu + options.overhead).max(1);
        let best = (fewest.min(options.most)..=options.most)
            .filter_map(|count| Draft::best(options, count))
            .max_by(|a, b| a.worth.total_cmp(&b.worth));
        let least = ModemError::Budget { budget: options.budget, picture: options.picture };
        best.and_then(|draft| draft.settle(options)).ok_or(least)
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
    pub(super) fn head(&self) -> usize {
        self.head
    }

    /// Bytes of a packet that any `arrived` shares give.
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

/// Bytes of the packet, in fractions, that any 1, 2, … shares give.
struct Draft {
    /// Number of shares.
    count: usize,
    /// Bytes of data in a share.
    data: usize,
    /// By shares that arrive, less one: bytes beyond the picture; `None`: no picture.
    beyond: Vec<Option<f64>>,
    worth: f64,
}

impl Draft {
    /// The best one for a number of shares.
    fn best(options: &SharingOptions, count: usize) -> Option<Draft> {
        let share = (options.budget / count).checked_sub(options.overhead)?.min(options.mtu);
        let data = share.checked_sub(LONGEST)?;
        let chances = options.loss.arrivals(count);
        (1..=count.min(LARGEST_FIRST))
            .filter_map(|first| Draft::with_first(options, count, data, first, &chances))
            .max_by(|a, b| a.worth.total_cmp(&b.worth))
    }

    /// The best one whose picture needs `first` shares.
    ///
    /// Of the shares' bytes, each byte that m shares give takes count / m. So if x(m) bytes are given by m shares, the
    /// bytes taken are the sum of x(m) · (count / m − count / (m + 1)), the last one's 1. With a worth of log(x), the best x are
    /// in proportion to chance / cost. They must grow with m. So neighbours that do not are given one value together
    /// (isotonic regression, by pooling adjacent violators).
    fn with_first(
        options: &SharingOptions,
        count: usize,
        data: usize,
        first: usize,
        chances: &[f64],
    ) -> Option<Draft> {
        let per = |m: usize| count as f64 / m as f64;
        let cost = |m: usize| if m == count { 1.0 } else { per(m) - per(m + 1) };
        let head = (options.picture + described(options)) as f64;
        let room = (count * data) as f64 - head * per(first);
        if room < 0.0 {
            return None;
        }
        let mut pools: Vec<Pool> = Vec::new();
        for m in first..=count {
            let mut pool = Pool { chance: chances[m], cost: cost(m), members: 1 };
            while let Some(last) = pools.pop_if(|last| last.ratio() >= pool.ratio()) {
                pool = pool.with(last);
            }
            pools.push(pool);
        }
        let most = options
            .packet
            .map_or(f64::INFINITY, |packet| packet.saturating_sub(options.picture) as f64);
        let scale = fill(&pools, room, most);
        let mut beyond = vec![None; first - 1];
        for pool in &pools {
            let bytes = pool.bytes(scale, most);
            beyond.extend(std::iter::repeat_n(Some(bytes), pool.members));
        }
        let each = beyond.iter().zip(&chances[1..]);
        let worth = each.map(|(bytes, chance)| chance * bytes.map_or(0.0, worth)).sum();
        Some(Draft { count, data, beyond, worth })
    }

    /// Layers of whole bytes.
    fn settle(&self, options: &SharingOptions) -> Option<Sharing> {
        let first = self.beyond.iter().position(Option::is_some)? + 1;
        let mut steps = Vec::new();
        let mut held = 0.0;
        for (m, bytes) in self.beyond.iter().enumerate() {
            let more = bytes.unwrap_or(0.0) - held;
            if more >= LEAST_CHUNK * (m + 1) as f64 && m + 1 > first && steps.len() < MAX_LAYERS - 1
            {
                steps.push((m + 1, more));
                held += more;
            } else if m + 1 == first {
                held = bytes.unwrap_or(0.0);
            }
        }
        let base = self.beyond[first - 1].unwrap_or(0.0);
        let head = described(options);
        let bytes = options.picture + head + base as usize;
        let chunk = bytes.div_ceil(first).min(self.data);
        let mut sharing = Sharing {
            layers: [Layer::default(); MAX_LAYERS],
            others: 0,
            count: self.count,
            head: 0,
        };
        sharing.layers[0] = Layer { threshold: first, chunk };
        let mut left = self.data - chunk;
        for (threshold, more) in steps {
            let chunk = ((more / threshold as f64).round() as usize).min(left);
            if chunk > 0 {
                sharing.others += 1;
                sharing.layers[sharing.others] = Layer { threshold, chunk };
                left -= chunk;
            }
        }
        sharing.give(left, options);
        Some(sharing)
    }
}

impl Sharing {
    /// Gives the last layer what rounding left, as far as the packet needs it; drops what no packet fills.
    fn give(&mut self, left: usize, options: &SharingOptions) {
        let user = options.user.map(|user| vec![0; user]);
        self.head = contents_len(&self.layers[1..=self.others], user.as_deref());
        let last = &mut self.layers[self.others];
        last.chunk += left;
        if let Some(packet) = options.packet {
            let spare = self.capacity().saturating_sub(packet);
            let last = &mut self.layers[self.others];
            last.chunk -= (spare / last.threshold).min(last.chunk - 1);
        }
    }
}

/// Bytes to reserve for what the first layer says: four other layers of two bytes each are usual.
fn described(options: &SharingOptions) -> usize {
    9 + options.user.map_or(0, |user| 1 + user)
}

/// Numbers of shares that give the same bytes.
#[derive(Clone, Copy)]
struct Pool {
    chance: f64,
    cost: f64,
    members: usize,
}

impl Pool {
    fn ratio(&self) -> f64 {
        self.chance / self.cost
    }

    fn with(self, other: Pool) -> Pool {
        Pool {
            chance: self.chance + other.chance,
            cost: self.cost + other.cost,
            members: self.members + other.members,
        }
    }

    /// Bytes beyond the picture at a scale, at most `most`.
    fn bytes(&self, scale: f64, most: f64) -> f64 {
        (scale * self.ratio() - KNEE).clamp(0.0, most)
    }
}

/// The scale at which the pools take `room` bytes, or all take `most`.
fn fill(pools: &[Pool], room: f64, most: f64) -> f64 {
    let taken = |scale: f64| pools.iter().map(|p| p.cost * p.bytes(scale, most)).sum::<f64>();
    let (mut low, mut high) = (0.0, 1.0);
    while taken(high) < room && high < 1e12 {
        high *= 2.0;
    }
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if taken(middle) <= room { low = middle } else { high = middle }
    }
    low
}
