//! Changes of learnt splats, as bits: which splats, then each number by what is known of the numbers beside it.

use super::change::Change;
use super::limits::MAX_LEARNT;
use crate::adaptive_numbers::{Chance, Magnitude, Size};
use crate::range_coder::Bits;
use crate::range_coder::EVEN;

/// Codes changes, of which a reader knows how many there are. The reason, if they cannot be read.
pub fn code(coder: &mut impl Bits, known: &[Change], count: usize) -> Result<Vec<Change>, String> {
    let (mut gaps, mut models) = (Magnitude::new(), Models::new());
    let (mut changes, mut due) = (Vec::new(), 0);
    for index in 0..count {
        let change = known.get(index).copied().unwrap_or_default();
        let ordinal = code_ordinal(coder, &mut gaps, due, change.ordinal);
        let ordinal = ordinal.ok_or_else(|| format!("changed splat {index} lies too far"))?;
        due = ordinal + 1;
        let read = models.code(coder, &Change { ordinal, ..change });
        changes.push(read.ok_or_else(|| format!("change {index} has a number of too many steps"))?);
    }
    Ok(changes)
}

/// Codes a learnt splat's place as how many it lies beyond `due`. `None` if a place read lies behind all that there can
/// be.
pub fn code_ordinal(
    coder: &mut impl Bits,
    gaps: &mut Magnitude,
    due: u16,
    ordinal: u16,
) -> Option<u16> {
    let gap = gaps.code(coder, ordinal.wrapping_sub(due).into());
    let ordinal = due.checked_add(u16::try_from(gap).ok()?)?;
    (usize::from(ordinal) < MAX_LEARNT).then_some(ordinal)
}

/// What is known of the changes before.
struct Models {
    position: Field,
    log_scale: Field,
    rotation: Field,
    opacity: Field,
    colour: Field,
}

impl Models {
    fn new() -> Models {
        let field = Field::new;
        Models {
            position: field(),
            log_scale: field(),
            rotation: field(),
            opacity: field(),
            colour: field(),
        }
    }

    /// `None` if a number read is none that a change can hold.
    fn code(&mut self, coder: &mut impl Bits, change: &Change) -> Option<Change> {
        let position = self.position.code(coder, change.position);
        let log_scale = self.log_scale.code(coder, change.log_scale.map(i32::from));
        let rotation = self.rotation.code(coder, change.rotation.map(i32::from));
        let [opacity] = self.opacity.code(coder, [change.opacity.into()]);
        let colour = self.colour.code(coder, change.colour.map(i32::from));
        Some(Change {
            ordinal: change.ordinal,
            position,
            log_scale: small(log_scale)?,
            rotation: small(rotation)?,
            opacity: opacity.try_into().ok()?,
            colour: small(colour)?,
        })
    }
}

fn small(values: [i32; 3]) -> Option<[i8; 3]> {
    let [a, b, c] = values.map(|value| i8::try_from(value).ok());
    Some([a?, b?, c?])
}

/// Numbers of one kind. How many of the others in the same splat are not zero, and the sign of the last one that is
/// not, tell what the next one may be.
struct Field {
    zero: [Chance; 3],
    negative: [Chance; 3],
    size: Size,
}

impl Field {
    fn new() -> Field {
        Field {
            zero: [Chance::of(EVEN, 2); 3],
            negative: [Chance::of(EVEN, 2); 3],
            size: Size::new(1),
        }
    }

    fn code<const N: usize>(&mut self, coder: &mut impl Bits, values: [i32; N]) -> [i32; N] {
        let (mut moved, mut sign) = (0, 0);
        values.map(|value| {
            if self.zero[moved].code(coder, value == 0) {
                return 0;
            }
            let negative = self.negative[sign].code(coder, value < 0);
            moved += 1;
            sign = 1 + usize::from(negative);
            self.size.code(coder, value, negative)
        })
    }
}
