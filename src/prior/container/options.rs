//! The part of render options.

use super::super::{PriorError, RenderOptions};
use super::words::{Words, refusal};

const FORMAT: &str = "render options";

pub fn to_bytes(options: &RenderOptions) -> Vec<u8> {
    let [r, g, b] = options.background;
    let focal = options.trained_focal.unwrap_or(0.0);
    let floats = [options.near, options.alpha_max, r, g, b, focal];
    let mut bytes: Vec<u8> = floats.into_iter().flat_map(f32::to_le_bytes).collect();
    bytes.push(options.antialiased.into());
    bytes
}

pub fn read(content: &[u8], at: usize) -> Result<RenderOptions, PriorError> {
    let mut words = Words::new(content, at);
    let [near, alpha_max, background @ .., focal] = words.floats::<6>()?;
    let (offset, antialiased) = (words.at(), words.byte()?);
    words.end(FORMAT)?;
    if antialiased > 1 {
        return Err(refusal(FORMAT, offset, format!("{antialiased} as a yes or no")));
    }
    let trained_focal = (focal != 0.0).then_some(focal);
    let antialiased = antialiased == 1;
    let options = RenderOptions { near, alpha_max, antialiased, background, trained_focal };
    options.check()?;
    Ok(options)
}
