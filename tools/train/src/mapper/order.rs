//! Which picture a step looks at.

use nvsprior::random::Random;

/// All pictures in turn, in an order that is another one in each round.
pub struct Order {
    seed: u64,
    /// The order of the round that was asked for last.
    order: Vec<usize>,
    round: Option<usize>,
}

impl Order {
    /// Of some pictures.
    pub fn new(seed: u64, pictures: impl IntoIterator<Item = usize>) -> Order {
        Order { seed, order: pictures.into_iter().collect(), round: None }
    }

    /// How many pictures have their turns.
    pub fn pictures(&self) -> usize {
        self.order.len()
    }

    /// The round of a step, and its place in it.
    pub fn at(&self, step: u32) -> (usize, usize) {
        (step as usize / self.order.len(), step as usize % self.order.len())
    }

    pub fn picture(&mut self, round: usize, place: usize) -> usize {
        if self.round != Some(round) {
            self.shuffle(round);
        }
        self.order[place]
    }

    fn shuffle(&mut self, round: usize) {
        let mut random = Random::new(self.seed ^ (round as u64) << 32);
        self.order.sort_unstable();
        for i in (1..self.order.len()).rev() {
            self.order.swap(i, (random.bits() % (i as u64 + 1)) as usize);
        }
        self.round = Some(round);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_round_shows_each_picture_once_in_an_order_of_its_own() {
        let mut order = Order::new(3, 0..20);
        let mut round =
            |round| -> Vec<usize> { (0..20).map(|i| order.picture(round, i)).collect() };
        let (first, second) = (round(0), round(1));
        assert_ne!(first, second);
        assert_eq!(first, round(0));
        for mut all in [first, second] {
            all.sort_unstable();
            assert_eq!(all, (0..20).collect::<Vec<_>>());
        }
    }
}
