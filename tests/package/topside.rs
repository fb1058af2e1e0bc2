//! The smallest topside: decodes the packets of a folder to PPM pictures. It is built without the feature `encode`, so
//! without search, encoder, training, modem and keys: `make firmware` prints its size.
//!
//! Usage: topside PRIOR PACKETS PICTURES

use std::error::Error;
use std::fs;
use std::path::Path;

use nvsprior::{Decoder, Engine, Picture, Prior};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [prior, packets, pictures] = &arguments[..] else {
        return Err("usage: topside PRIOR PACKETS PICTURES".into());
    };
    let engine = Engine::new(&Default::default())?;
    let scene = engine.upload(&Prior::open(prior.as_ref(), &Default::default())?)?;
    let mut decoder = Decoder::new(&engine, &scene);
    let files: Result<Vec<_>, _> = fs::read_dir(packets)?.collect();
    let mut files: Vec<_> = files?.iter().map(fs::DirEntry::path).collect();
    files.sort();
    for file in files {
        let decoded = decoder.decode(&fs::read(&file)?)?;
        let name = file.with_extension("ppm");
        let name = name.file_name().ok_or("a packet without a name")?;
        fs::write(Path::new(pictures).join(name), ppm(&decoded.picture))?;
    }
    Ok(())
}

fn ppm(picture: &Picture) -> Vec<u8> {
    let mut bytes = format!("P6\n{} {}\n255\n", picture.width, picture.height).into_bytes();
    bytes.extend(&picture.data);
    bytes
}
