//! The machine that a device is in, as far as the system tells.

use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Host {
    pub processor: Option<String>,
    /// A board's name, if the system has a device tree.
    pub board: Option<String>,
    /// Threads that run at once.
    pub threads: usize,
    pub system: String,
}

impl Host {
    /// This machine.
    pub fn here() -> Host {
        let read = |path| std::fs::read_to_string(path).ok();
        Host {
            processor: read("/proc/cpuinfo").and_then(|text| processor(&text)),
            board: read("/proc/device-tree/model").and_then(|text| named(&text)),
            threads: std::thread::available_parallelism().map_or(1, |threads| threads.get()),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        }
    }
}

/// The processor's name in `/proc/cpuinfo`. 64-bit ARM has none there.
fn processor(text: &str) -> Option<String> {
    let value = |line: &str| {
        let (key, value) = line.split_once(':')?;
        (key.trim() == "model name").then(|| named(value))?
    };
    text.lines().find_map(value)
}

/// A name without what surrounds it; `None` if nothing is left.
fn named(text: &str) -> Option<String> {
    let name = text.trim_matches(|c: char| c.is_whitespace() || c == '\0');
    (!name.is_empty()).then(|| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_the_system_writes_them() {
        let text = "processor\t: 0\nmodel\t\t: 1\nmodel name\t: Some CPU @ 2 GHz \n";
        assert_eq!(processor(text).as_deref(), Some("Some CPU @ 2 GHz"));
        assert_eq!(processor("processor\t: 0\nCPU part\t: 0xd42\n"), None);
        assert_eq!(named("A board\0").as_deref(), Some("A board"));
    }
}
