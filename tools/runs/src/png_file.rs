//! Pictures as PNG files.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use nvsprior::Picture;
use nvsprior::prior::{PriorError, replace_file};
use png::{BitDepth, ColorType, Compression, Decoder, Encoder, Filter};

#[derive(Debug, thiserror::Error)]
pub enum PngFileError {
    #[error("cannot write {}: {error}", path.display())]
    Write { path: PathBuf, error: png::EncodingError },
    #[error(transparent)]
    Replace(#[from] PriorError),
    #[error("cannot read {}: {error}", path.display())]
    Read { path: PathBuf, error: png::DecodingError },
    #[error("{}: a PNG of 8-bit RGB is needed, as this program writes them", path.display())]
    Kind { path: PathBuf },
}

/// Writes a picture as a PNG, whatever the file's name ends in. What was there is lost only once the new one is whole.
pub fn write_png(path: &Path, picture: &Picture) -> Result<(), PngFileError> {
    let bytes = png_of(picture);
    let bytes = bytes.map_err(|error| PngFileError::Write { path: path.to_path_buf(), error })?;
    Ok(replace_file(path, &bytes)?)
}

/// A picture as PNG, quickly.
pub fn png_of(picture: &Picture) -> Result<Vec<u8>, png::EncodingError> {
    marked_png(picture, None)
}

/// [`png_of`], with what it says of itself.
pub fn marked_png(picture: &Picture, mark: Option<&str>) -> Result<Vec<u8>, png::EncodingError> {
    png(ColorType::Rgb, (picture.width, picture.height), &picture.data, mark)
}

/// Grey levels in rows as PNG.
pub fn marked_grey_png(
    size: (u32, u32),
    levels: &[u8],
    mark: &str,
) -> Result<Vec<u8>, png::EncodingError> {
    png(ColorType::Grayscale, size, levels, Some(mark))
}

/// The keyword of what a picture says of itself.
const MARK: &str = "Software";

fn png(
    colour: ColorType,
    (width, height): (u32, u32),
    data: &[u8],
    mark: Option<&str>,
) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height);
    encoder.set_color(colour);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Adaptive);
    if let Some(mark) = mark {
        encoder.add_text_chunk(MARK.into(), mark.into())?;
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(data)?;
    writer.finish()?;
    Ok(bytes)
}

/// Whether a file is a PNG that says this of itself.
pub fn is_marked(path: &Path, mark: &str) -> bool {
    let Ok(file) = File::open(path) else { return false };
    let Ok(reader) = Decoder::new(BufReader::new(file)).read_info() else { return false };
    let mut texts = reader.info().uncompressed_latin1_text.iter();
    texts.any(|text| text.keyword == MARK && text.text == mark)
}

/// Reads a picture that [`write_png`] wrote.
pub fn read_png(path: &Path) -> Result<Picture, PngFileError> {
    let failed = |error| PngFileError::Read { path: path.to_path_buf(), error };
    let strange = || PngFileError::Kind { path: path.to_path_buf() };
    let file = File::open(path).map_err(|error| failed(error.into()))?;
    let mut reader = Decoder::new(BufReader::new(file)).read_info().map_err(failed)?;
    let info = reader.info();
    let (width, height) = info.size();
    if (info.color_type, info.bit_depth) != (ColorType::Rgb, BitDepth::Eight) {
        return Err(strange());
    }
    let mut data = vec![0; reader.output_buffer_size().ok_or_else(strange)?];
    reader.next_frame(&mut data).map_err(failed)?;
    Picture::from_rgb(width, height, data).ok_or_else(strange)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let picture = Picture::from_rgb(4, 2, (0..24).collect()).unwrap();
        write_png(&path, &picture).unwrap();
        assert_eq!(read_png(&path).unwrap(), picture);
    }

    #[test]
    fn what_is_no_picture_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        std::fs::write(&path, b"no picture").unwrap();
        let error = read_png(&path).unwrap_err();
        assert!(matches!(error, PngFileError::Read { .. }) && error.to_string().contains("a.png"));
        let grey = Encoder::new(File::create(&path).unwrap(), 1, 1);
        grey.write_header().unwrap().write_image_data(&[7]).unwrap();
        assert!(matches!(read_png(&path), Err(PngFileError::Kind { .. })));
        let nowhere = folder.path().join("none/a.png");
        let error = write_png(&nowhere, &Picture::new(1, 1)).unwrap_err();
        assert!(error.to_string().contains("none/a.png"), "{error}");
    }
}
