//! How a packet is divided into layers, so that what arrives is worth most.

use super::super::ModemError;
use super::chain::Loss;
use super::header::{LARGEST_FIRST, MAX_SHARES, header_len};
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
    /// Bytes that the link carries between the first share of the packet and its last one, if other packets' shares lie
    /// between them; 0: they follow each other.
    pub spread: usize,
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
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sharing {
    layers: [Layer; MAX_LAYERS],
    others: usize,
    count: usize,
    /// Bytes of the first layer that are not the packet's.
    head: usize,
    worth: f64,
}

/// Least MTU that shares are made for, bytes.
const SMALLEST_MTU: usize = 16;
/// Worth of a picture beside what is shown without it, dB: the last one, or the prior at a pose between others.
const PICTURE: f64 = 3.0;
/// Bytes of a residual up to which each counts as much as the one before, and from which as many more are as much
/// better: what a steady packet takes before the picture gains from it.
const KNEE: f64 = 3.0;
/// Fewest bytes of a layer, per share of its threshold. Smaller ones do not pay for their description.
const LEAST_CHUNK: f64 = 2.0;

/// Worth of the first bytes of a packet in dB, `bytes` beyond what makes a picture. Each doubling of the residual is worth
/// 1.2 dB, as the wavelet coder's bytes at 31 to 33 dB show (docs/mapping.md).
fn worth(bytes: f64) -> f64 {
    static P: std::sync::OnceLock<f64> = std::sync::OnceLock::new();
    let picture = *P.get_or_init(|| {
        std::env::var("NVSP_PIC").ok().and_then(|t| t.parse().ok()).unwrap_or(PICTURE)
    });
    picture + 1.2 * (1.0 + bytes / KNEE).log2()
}

impl SharingOptions {
    /// # Errors
    /// With the name of what is wrong.
    pub(in super::super) fn check(&self) -> Result<(), ModemError> {
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
    /// The division of greatest expected worth. It looks at every number of shares, at every threshold of the picture and
    /// at every number of layers.
    ///
    /// # Errors
    /// If an option is outside its range, or the budget holds no picture: [`ModemError::Budget`] says what would.
    pub fn new(options: &SharingOptions) -> Result<Sharing, ModemError> {
        options.check()?;
        let fewest = options.budget.div_ceil(options.mtu + options.overhead).max(1);
        let counts = fewest.min(options.most)..=options.most;
        let best = counts.filter_map(|count| Draft::best(options, count));
        let best = best.max_by(|a, b| a.worth.total_cmp(&b.worth));
        best.ok_or(ModemError::Budget { budget: options.budget, picture: options.picture })
    }

    /// Mean worth of what arrives, about dB.
    pub fn worth(&self) -> f64 {
        self.worth
    }

    /// The same, from the chances that 0, 1, … shares arrive.
    fn expect(&self, options: &SharingOptions, chances: &[f64]) -> f64 {
        let most = options.packet.unwrap_or(usize::MAX);
        let of = |arrived| match self.prefix(arrived).min(most).checked_sub(options.picture) {
            Some(beyond) if arrived >= self.layers[0].threshold => worth(beyond as f64),
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

/// What a division is made from.
struct Draft<'a> {
    options: &'a SharingOptions,
    /// Number of shares.
    count: usize,
    /// Bytes of data in a share.
    data: usize,
    /// Chances that 0, 1, … shares arrive.
    chances: &'a [f64],
}

impl Draft<'_> {
    /// The best division for a number of shares.
    fn best(options: &SharingOptions, count: usize) -> Option<Sharing> {
        let share = (options.budget / count).checked_sub(options.overhead)?.min(options.mtu);
        let data = share.checked_sub(header_len(count, share, share))?;
        let apart =
            options.spread as f64 / ((share + options.overhead) * (count - 1).max(1)) as f64;
        let chances = options.loss.spaced(apart).arrivals(count);
        let draft = Draft { options, count, data, chances: &chances };
        let mut best: Option<Sharing> = None;
        for first in 1..=count.min(LARGEST_FIRST) {
            for others in 0..MAX_LAYERS {
                let Some((mut sharing, full)) = draft.divide(first, others) else { break };
                sharing.worth = sharing.expect(options, &chances);
                if best.is_none_or(|best| sharing.worth > best.worth) {
                    best = Some(sharing);
                }
                if !full {
                    break;
                }
            }
        }
        best
    }

    /// A division whose picture needs `first` shares and that has up to `others` layers more; and whether more layers
    /// would make it another one. `None`: there is no room for the picture.
    ///
    /// Of the shares' bytes, each byte that m shares give takes count / m. So if x(m) bytes are given by m shares, the
    /// bytes taken are the sum of x(m) · (count / m − count / (m + 1)), the last one's 1. With a worth of log(x), the best
    /// x are in proportion to chance / cost. They must grow with m. So neighbours that do not are given one value together
    /// (isotonic regression, by pooling adjacent violators).
    fn divide(&self, first: usize, others: usize) -> Option<(Sharing, bool)> {
        let Draft { options, count, data, chances } = *self;
        let per = |m: usize| count as f64 / m as f64;
        let cost = |m: usize| if m == count { 1.0 } else { per(m) - per(m + 1) };
        let start = options.picture + described(options, others);
        let room = (count * data) as f64 - start as f64 * per(first);
        if room < 0.0 || start.div_ceil(first) > data {
            return None;
        }
        let mut pools: Vec<Pool> = Vec::new();
        for m in first..=count {
            let mut pool = Pool { chance: chances[m], cost: cost(m), threshold: m };
            while let Some(last) = pools.pop_if(|last| last.ratio() >= pool.ratio()) {
                pool = pool.after(last);
            }
            pools.push(pool);
        }
        let packet = options.packet.unwrap_or(usize::MAX);
        let most = packet.saturating_sub(options.picture) as f64;
        let scale = fill(&pools, room, most);
        let mut steps = Steps::new(&pools, scale, most);
        let full = steps.shorten(others);
        Some((self.settle(first, start, &steps), full))
    }

    /// Layers of whole bytes. The last one gets what rounding leaves, as far as the packet needs it.
    fn settle(&self, first: usize, start: usize, steps: &Steps) -> Sharing {
        let chunk = (start + steps.base as usize).div_ceil(first).min(self.data);
        let layers = [Layer::default(); MAX_LAYERS];
        let mut sharing = Sharing { layers, others: 0, count: self.count, head: 0, worth: 0.0 };
        sharing.layers[0] = Layer { threshold: first, chunk };
        let mut left = self.data - chunk;
        for (threshold, more) in &steps.more {
            let chunk = ((more / *threshold as f64).round() as usize).min(left);
            if chunk > 0 {
                sharing.others += 1;
                sharing.layers[sharing.others] = Layer { threshold: *threshold, chunk };
                left -= chunk;
            }
        }
        sharing.give(left, self.options);
        sharing
    }
}

/// What the picture's shares give beyond it, and what more shares give beyond that, in bytes.
struct Steps {
    base: f64,
    /// Number of shares, and bytes.
    more: Vec<(usize, f64)>,
}

impl Steps {
    fn new(pools: &[Pool], scale: f64, most: f64) -> Steps {
        let mut held = pools[0].bytes(scale, most);
        let mut steps = Steps { base: held, more: Vec::new() };
        for pool in &pools[1..] {
            let more = pool.bytes(scale, most) - held;
            if more >= LEAST_CHUNK * pool.threshold as f64 {
                steps.more.push((pool.threshold, more));
                held += more;
            }
        }
        steps
    }

    /// Joins the smallest steps with those after them, until there are no more than `count`. Tells whether it had to.
    fn shorten(&mut self, count: usize) -> bool {
        let full = self.more.len() > count;
        while self.more.len() > count {
            let smallest =
                (0..self.more.len()).min_by(|a, b| self.more[*a].1.total_cmp(&self.more[*b].1));
            let (_, bytes) = self.more.remove(smallest.unwrap_or(0));
            if let Some(next) = self.more.get_mut(smallest.unwrap_or(0)) {
                next.1 += bytes;
            }
        }
        full
    }
}

impl Sharing {
    /// Gives the last layer what rounding left, as far as the packet needs it; drops what no packet fills.
    fn give(&mut self, left: usize, options: &SharingOptions) {
        let user = options.user.map(|user| vec![0; user]);
        self.layers[self.others].chunk += left;
        loop {
            self.head = contents_len(&self.layers[1..=self.others], user.as_deref());
            let Some(packet) = options.packet else { return };
            let spare = self.capacity().saturating_sub(packet);
            let last = &mut self.layers[self.others];
            let useless = (spare / last.threshold).min(last.chunk);
            last.chunk -= if self.others == 0 { useless.min(last.chunk - 1) } else { useless };
            if last.chunk > 0 {
                return;
            }
            self.others -= 1;
        }
    }
}

/// Bytes of the first layer that are not the packet's: usually two for each other layer.
fn described(options: &SharingOptions, others: usize) -> usize {
    let chunks = if options.mtu < 128 { 2 } else { 3 };
    1 + chunks * others + options.user.map_or(0, |user| 1 + user)
}

/// Neighbouring numbers of shares that give the same bytes.
#[derive(Clone, Copy)]
struct Pool {
    chance: f64,
    cost: f64,
    /// The smallest of the numbers.
    threshold: usize,
}

impl Pool {
    fn ratio(&self) -> f64 {
        self.chance / self.cost
    }

    fn after(self, other: Pool) -> Pool {
        Pool {
            chance: self.chance + other.chance,
            cost: self.cost + other.cost,
            threshold: other.threshold,
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
