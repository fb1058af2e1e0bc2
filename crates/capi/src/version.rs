//! Versions.

use std::ffi::c_char;

use super::structs::{NVSP_ABI_VERSION, NVSP_VERSION_NUMBER, Place};

/// Returns the version of the library in use, such as "1.0.0". The text is static. NVSP_INIT and every call that takes
/// a structure refuse a program made for another NVSP_ABI_VERSION.
///
/// # Parameters
/// - `number`: receives it as one number, as NVSP_VERSION_NUMBER has it for the header. NULL: not wanted.
/// - `abi_version`: receives the ABI version that the library speaks. NULL: not wanted.
#[unsafe(no_mangle)]
pub extern "C" fn nvsp_version(number: Place<u32>, abi_version: Place<u32>) -> *const c_char {
    const TEXT: &std::ffi::CStr = match std::ffi::CStr::from_bytes_with_nul(
        concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes(),
    ) {
        Ok(text) => text,
        Err(_) => panic!("a version without NUL"),
    };
    number.write(NVSP_VERSION_NUMBER);
    abi_version.write(NVSP_ABI_VERSION);
    TEXT.as_ptr()
}

#[cfg(test)]
mod tests {
    use super::super::structs::*;

    #[test]
    fn the_header_has_the_version_of_the_package() {
        let numbers = (NVSP_VERSION_MAJOR, NVSP_VERSION_MINOR, NVSP_VERSION_PATCH);
        let (major, minor, patch) = numbers;
        assert_eq!(env!("CARGO_PKG_VERSION"), format!("{major}.{minor}.{patch}"));
        assert_eq!(NVSP_VERSION_NUMBER, 1_000_000 * major + 1000 * minor + patch);
    }

    #[test]
    fn the_flags_of_a_structure_are_numbered_from_one() {
        use super::super::{decoder, encoder, engine, frame, prior, vehicle};
        let shared = [encoder::NVSP_FRAME_UNCERTAIN, encoder::NVSP_FRAME_NOT_PORTABLE];
        let of_frame = |own: &[u32]| [&shared[..], own].concat();
        let structures = [
            of_frame(&[encoder::NVSP_FRAME_RATE_MISSED, encoder::NVSP_FRAME_UNDETERMINED]),
            of_frame(&[
                decoder::NVSP_DECODED_SAME_RENDER,
                decoder::NVSP_DECODED_OTHER_RENDER,
                decoder::NVSP_DECODED_INTER,
                decoder::NVSP_DECODED_KEPT,
                decoder::NVSP_DECODED_FILTERED,
                encoder::NVSP_FRAME_POSITION_KNOWN,
                decoder::NVSP_DECODED_WHOLE,
                decoder::NVSP_DECODED_BETWEEN,
                decoder::NVSP_DECODED_RESTARTED,
                decoder::NVSP_DECODED_POSE,
                decoder::NVSP_DECODED_SESSION,
            ]),
            vec![decoder::NVSP_DECODE_START],
            vec![frame::NVSP_GIVEN_TIME],
            vec![engine::NVSP_ENGINE_VALIDATION],
            vec![
                prior::NVSP_PRIOR_NEAR,
                prior::NVSP_PRIOR_ALPHA_MAX,
                prior::NVSP_PRIOR_ANTIALIASED,
                prior::NVSP_PRIOR_BACKGROUND,
            ],
            vec![
                vehicle::NVSP_LINK_UTC,
                vehicle::NVSP_LINK_NO_REPORTS,
                vehicle::NVSP_LINK_PULL,
                vehicle::NVSP_LINK_AS_THEY_COME,
                vehicle::NVSP_LINK_UNPROTECTED,
                vehicle::NVSP_LINK_NO_STAMPS,
                vehicle::NVSP_LINK_STATE_POSES,
                vehicle::NVSP_LINK_MODEM_CHECKS,
            ],
        ];
        for flags in structures {
            for (place, flag) in flags.iter().enumerate() {
                assert_eq!(*flag, 1 << place, "{flags:?}");
            }
        }
    }
}
