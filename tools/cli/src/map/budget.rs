//! How long a training takes.

#[derive(Clone, Copy, Debug)]
pub enum Budget {
    Iterations(u32),
    /// Seconds on the clock.
    Seconds(f64),
}

impl Budget {
    /// A share of it.
    pub fn times(self, share: f64) -> Budget {
        match self {
            Budget::Iterations(all) => Budget::Iterations((f64::from(all) * share).ceil() as u32),
            Budget::Seconds(all) => Budget::Seconds(all * share),
        }
    }
}
