//! Pictures to ffmpeg and back, and what its elementary streams have in common.

use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, ensure};
use nvsprior::Picture;

/// To YUV and back with the same conversion, full range.
pub const TO_YUV: &str =
    "scale=out_color_matrix=bt709:out_range=pc:flags=accurate_rnd+full_chroma_int";
pub const FROM_YUV: &str =
    "scale=in_color_matrix=bt709:in_range=pc:flags=accurate_rnd+full_chroma_int";
/// Raw pictures.
pub const RGB: [&str; 4] = ["-f", "rawvideo", "-pix_fmt", "rgb24"];
/// Says what goes wrong, and no more.
pub const QUIET: [&str; 3] = ["-v", "error", "-y"];

/// Runs a program; an error has what it said.
pub fn run_program(program: &str, arguments: &[&str]) -> anyhow::Result<Vec<u8>> {
    let output = Command::new(program).args(arguments).output();
    let output = output.with_context(|| format!("running {program}"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{program} {}: {said}", arguments.join(" "));
    Ok(output.stdout)
}

/// Runs ffmpeg; an error has what it said.
pub fn run(arguments: &[&str]) -> anyhow::Result<Vec<u8>> {
    run_program("ffmpeg", arguments)
}

/// Whether ffmpeg is there and has an encoder.
pub fn has_encoder(encoder: &str) -> bool {
    run(&["-v", "error", "-encoders"])
        .is_ok_and(|list| String::from_utf8_lossy(&list).contains(encoder))
}

/// Writes pictures of one size as the raw ones that ffmpeg reads.
pub fn write_raw<'a>(
    file: &Path,
    pictures: impl IntoIterator<Item = &'a Picture>,
) -> anyhow::Result<()> {
    let bytes: Vec<u8> = pictures.into_iter().flat_map(|of| &of.data).copied().collect();
    std::fs::write(file, bytes).with_context(|| format!("writing {}", file.display()))
}

/// Reads all whole pictures of a file of raw ones.
pub fn read_raw(file: &Path, width: u32, height: u32) -> anyhow::Result<Vec<Picture>> {
    let bytes = std::fs::read(file).with_context(|| format!("reading {}", file.display()))?;
    let whole = bytes.chunks_exact(width as usize * height as usize * 3);
    Ok(whole.filter_map(|rgb| Picture::from_rgb(width, height, rgb.to_vec())).collect())
}

/// The start codes of an H.26x stream: the place of each, and its length, 3 or 4 bytes. None is amid a unit.
pub fn start_codes(stream: &[u8]) -> impl Iterator<Item = (usize, usize)> {
    let codes = stream.windows(3).enumerate().filter(|(_, bytes)| *bytes == [0, 0, 1]);
    codes.map(|(at, _)| if at > 0 && stream[at - 1] == 0 { (at - 1, 4) } else { (at, 3) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn start_codes_are_found_in_both_lengths() {
        let codes: Vec<_> = start_codes(&[0, 0, 0, 1, 9, 0, 0, 1, 7, 0, 0, 3, 1]).collect();
        assert_eq!(codes, [(0, 4), (5, 3)]);
        assert_eq!(start_codes(&[0, 1]).count(), 0);
    }
}
