//! The part of coder tables.

use super::super::PriorError;
use super::words::refusal;
use crate::coder_tables::{Tables, TablesError};

pub fn read(content: &[u8], at: usize) -> Result<Tables, PriorError> {
    Tables::read(content).map_err(|error| {
        let within = match error {
            TablesError::Magic => 0,
            TablesError::Length { expected, found } => expected.min(found),
        };
        refusal("coder tables", at + within, error)
    })
}
