//! Room on the disk that snapshots and recordings go to.

use std::path::Path;

use super::state::RecordingState;

/// Bytes, and seconds of the recording that runs, below which the pilot is warned.
const FEW_BYTES: u64 = 100_000_000;
const SHORT: f64 = 600.0;

/// Bytes that may still be written below a folder, which need not be there yet; `None`: the system does not tell.
pub fn free(folder: &Path) -> Option<u64> {
    #[cfg(unix)]
    return folder.ancestors().find_map(|above| {
        let above = if above.as_os_str().is_empty() { Path::new(".") } else { above };
        let told = rustix::fs::statvfs(above).ok()?;
        told.f_bavail.checked_mul(told.f_frsize)
    });
    #[cfg(not(unix))]
    return None.filter(|_: &u64| folder.exists());
}

/// What to tell the pilot before the disk is full.
pub fn warning(free: u64, recording: Option<&RecordingState>) -> Option<String> {
    let left = recording.map_or(f64::INFINITY, |recording| {
        free as f64 * recording.seconds / recording.bytes as f64
    });
    let room = format!("The disk for snapshots and recordings has {} MB left", free / 1_000_000);
    match () {
        () if left < SHORT => {
            Some(format!("{room}: {:.0} minutes of this recording.", left / 60.0))
        }
        () if free < FEW_BYTES => Some(format!("{room}.")),
        () => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_warns_by_bytes_and_by_minutes() {
        let there = std::env::temp_dir();
        assert!(free(&there.join("not/yet")).is_some() || free(&there).is_none());
        let recording = |bytes| RecordingState { frames: 1, bytes, seconds: 100.0 };
        assert_eq!(warning(FEW_BYTES, Some(&recording(25_000))), None);
        let little = warning(FEW_BYTES - 1, Some(&recording(25_000))).unwrap();
        assert!(little.ends_with("has 99 MB left."), "{little}");
        let fast = warning(2 * FEW_BYTES, Some(&recording(50_000_000))).unwrap();
        assert!(fast.ends_with("has 200 MB left: 7 minutes of this recording."), "{fast}");
        assert_eq!(warning(2 * FEW_BYTES, None), None);
    }
}
