//! What long work says of itself.

#[derive(Clone, Debug, PartialEq)]
pub enum Progress {
    /// What a user should know.
    Says(String),
    /// What a user should think about.
    Warns(String),
    /// A step, by what it does.
    Begins(String),
    /// A step was finished by an earlier run.
    WasDone(String),
    /// Share of the step that is done, 0 to 1, if it is known. It may go back.
    At(Option<f64>),
    Ends,
}

/// Who is told.
pub type Watch<'a> = &'a mut dyn FnMut(Progress);
