//! Reading a prior's file, of any format.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::error::PriorError;
use super::file_content::PriorFile;
use super::{blocked, compact, ply};
#[cfg(feature = "formats")]
use super::{gltf, sog, spz};

/// Reads a file's content. The first bytes tell the format.
pub(super) fn read(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    if bytes.starts_with(compact::MAGIC) {
        return compact::read(bytes);
    }
    if bytes.starts_with(&blocked::MAGIC) {
        return blocked::read(bytes);
    }
    #[cfg(feature = "formats")]
    if spz::MAGICS.iter().any(|magic| bytes.starts_with(magic)) {
        return spz::read(bytes);
    }
    #[cfg(feature = "formats")]
    if bytes.starts_with(gltf::MAGIC) {
        return gltf::read(bytes);
    }
    #[cfg(feature = "formats")]
    if bytes.starts_with(sog::MAGIC) {
        return sog::read(bytes);
    }
    ply::read_ply(bytes)
}

/// Whether files of a known format start so.
fn is_known(start: &[u8]) -> bool {
    let known = [ply::MAGIC, compact::MAGIC, &blocked::MAGIC];
    let known = known.iter().any(|magic| start.starts_with(magic));
    #[cfg(feature = "formats")]
    let known = known
        || [spz::MAGICS[0], spz::MAGICS[1], gltf::MAGIC, sog::MAGIC]
            .iter()
            .any(|magic| start.starts_with(magic));
    known
}

/// Longest start of a file that tells its format, bytes.
const LONGEST_MAGIC: u64 = 4;

/// Reads the file. If its first bytes show another format, reads no further, so that a wrong path
/// (a device, a video) costs neither time nor memory.
pub(super) fn read_prior_file(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    let mut bytes = Vec::new();
    (&mut file).take(LONGEST_MAGIC).read_to_end(&mut bytes)?;
    if is_known(&bytes) {
        file.read_to_end(&mut bytes)?;
    }
    Ok(bytes)
}
