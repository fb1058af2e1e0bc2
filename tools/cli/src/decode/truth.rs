//! Truth maps as pictures.

use std::path::{Path, PathBuf};

use nvsprior::Picture;
use nvsprior::truth::{BLOCK, TruthLevel, TruthMap};
use nvsprior_inputs::{frame_file, values};

use anyhow::Context;

/// Where truth maps are written.
#[derive(clap::Args)]
pub struct TruthArgs {
    /// Folder for truth maps, NAME.png: grey, a pixel for a block of 16×16. 0: the picture is as seen; 1: it differs;
    /// 2: it is wrong; 3: nothing is known of it
    #[arg(long, value_name = "DIR")]
    truth: Option<PathBuf>,
    /// Folder for the pictures with the truth map drawn over them, NAME.png. Yellow stripes: it differs; magenta
    /// lattice: it is wrong; grey, with dots: nothing is known of it
    #[arg(long, value_name = "DIR")]
    overlay: Option<PathBuf>,
}

impl TruthArgs {
    /// Makes the folders.
    pub fn check(&self) -> anyhow::Result<()> {
        let folders = [("--truth", &self.truth), ("--overlay", &self.overlay)];
        for (name, folder) in folders {
            if let Some(folder) = folder {
                values::make_folder(name, folder)?;
            }
        }
        Ok(())
    }

    /// Writes what is asked for. `name`: of the pictures.
    pub fn write(&self, name: &Path, picture: &Picture, map: &TruthMap) -> anyhow::Result<()> {
        if let Some(folder) = &self.truth {
            let path = folder.join(name);
            let grey = image::GrayImage::from_raw(map.columns, map.rows, map.levels.clone());
            let grey = grey.context("a truth map without blocks")?;
            grey.save(&path).with_context(|| format!("writing {}", path.display()))?;
        }
        if let Some(folder) = &self.overlay {
            frame_file::write_png(&folder.join(name), &overlaid(picture, map))?;
        }
        Ok(())
    }
}

/// A picture with its truth map drawn over it: colours and patterns that the colour-blind can tell.
fn overlaid(picture: &Picture, map: &TruthMap) -> Picture {
    const YELLOW: [u8; 3] = [255, 220, 0];
    const MAGENTA: [u8; 3] = [255, 0, 200];
    let mut shown = picture.clone();
    let width = picture.width;
    for (at, rgb) in shown.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let (x, y) = (at as u32 % width, at as u32 / width);
        let level = map.levels[(y / BLOCK * map.columns + x / BLOCK) as usize];
        let stripe = (x + y).is_multiple_of(8);
        let other_stripe = (x + BLOCK - y % BLOCK).is_multiple_of(8);
        match level {
            level if level == TruthLevel::Differs as u8 && stripe => *rgb = YELLOW,
            level if level == TruthLevel::Wrong as u8 && (stripe || other_stripe) => *rgb = MAGENTA,
            level if level == TruthLevel::NotSeen as u8 => {
                let grey = (rgb.iter().map(|v| u16::from(*v)).sum::<u16>() / 3) as u8;
                let dot = x.is_multiple_of(8) && y.is_multiple_of(8);
                *rgb = if dot { [230; 3] } else { [grey; 3] };
            }
            _ => {}
        }
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_level_has_a_pattern_of_its_own() {
        let mut picture = Picture::new(64, 16);
        picture.data.as_chunks_mut::<3>().0.fill([20, 60, 100]);
        let mut map = TruthMap::not_seen(64, 16);
        map.levels = vec![0, 1, 2, 3];
        let shown = overlaid(&picture, &map);
        let changed = |block: usize| {
            let pixels = shown.data.as_chunks::<3>().0.iter().enumerate();
            let of_block = pixels.filter(|(at, _)| at % 64 / 16 == block);
            of_block.filter(|(_, rgb)| **rgb != [20, 60, 100]).count()
        };
        assert_eq!(changed(0), 0);
        assert_eq!(changed(1), 32, "a pixel in eight");
        assert!((49..64).contains(&changed(2)), "{}: both ways, where they cross once", changed(2));
        assert_eq!(changed(3), 256);
    }
}
