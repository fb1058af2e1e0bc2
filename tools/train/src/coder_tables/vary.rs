//! Frames and their renders, also as other scenes, dives and cameras might give them.

use nvsprior::Picture;
use nvsprior::random::Random;

use super::silt::Silt;

/// A frame and its render, as the encoder has them.
pub struct Pair {
    /// What the camera saw.
    pub frame: Picture,
    /// What the prior shows at the pose found.
    pub render: Picture,
}

/// A pair made of one of `all`: mirrored, lit otherwise, beside another's render or none.
pub fn vary(pair: &Pair, all: &[Pair], random: &mut Random) -> Pair {
    let other = &all[(random.bits() % all.len() as u64) as usize];
    let same_size =
        (other.render.width, other.render.height) == (pair.frame.width, pair.frame.height);
    let mut frame = pair.frame.clone();
    let mut render = match random.bits() % 8 {
        0 if same_size => other.render.clone(),
        1 => grey(&frame),
        _ => pair.render.clone(),
    };
    if random.bits().is_multiple_of(2) {
        mirror(&mut frame);
        mirror(&mut render);
    }
    Light::some(random).apply(&mut frame);
    if random.bits().is_multiple_of(4) {
        Silt::some(random).apply(&mut frame, random);
    }
    Pair { frame, render }
}

/// Other light, or none.
pub struct Light(Option<(f32, f32, [f32; 3])>);

impl Light {
    /// In one case of four another one.
    pub fn some(random: &mut Random) -> Light {
        Light(random.bits().is_multiple_of(4).then(|| {
            let gain = random.within(0.5, 1.4);
            (gain, random.within(-20.0, 20.0), random.triple(0.85, 1.15))
        }))
    }

    /// Lights a picture so.
    pub fn apply(&self, picture: &mut Picture) {
        let Some((gain, offset, cast)) = self.0 else { return };
        for (i, value) in picture.data.iter_mut().enumerate() {
            *value =
                (f32::from(*value) * gain * cast[i % 3] + offset).round().clamp(0.0, 255.0) as u8;
        }
    }
}

/// A render that shows nothing.
fn grey(of: &Picture) -> Picture {
    let mut grey = of.clone();
    grey.data.fill(128);
    grey
}

/// Exchanges left and right.
pub fn mirror(picture: &mut Picture) {
    let width = picture.width as usize;
    for row in picture.data.chunks_mut(width * 3) {
        for x in 0..width / 2 {
            for channel in 0..3 {
                row.swap(3 * x + channel, 3 * (width - 1 - x) + channel);
            }
        }
    }
}
