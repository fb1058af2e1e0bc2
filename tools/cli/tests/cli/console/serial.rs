//! A console whose modem is on a serial line.

use std::io::{Read, Write};

use super::Console;
use crate::dive::Dive;

/// A modem: a pseudo-terminal whose other side has a name in a folder.
struct Modem(std::fs::File);

impl Modem {
    fn plug_in(dive: &Dive) -> Modem {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        // A console that inherited it would keep it alive.
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let modem = openpt(flags).unwrap();
        grantpt(&modem).unwrap();
        unlockpt(&modem).unwrap();
        let port = ptsname(&modem, Vec::new()).unwrap();
        let name = dive.path("tty");
        let _ = std::fs::remove_file(&name);
        std::os::unix::fs::symlink(port.to_str().unwrap(), name).unwrap();
        Modem(modem.into())
    }

    fn send(&mut self, bytes: &[u8]) {
        self.0.write_all(&cobs::encode_vec(bytes)).unwrap();
        self.0.write_all(&[0]).unwrap();
    }

    /// The next modem frame that comes.
    fn receive(&mut self) -> Vec<u8> {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        let (mut framed, mut byte) = (Vec::new(), [0]);
        let patience = Timespec { tv_sec: 20, tv_nsec: 0 };
        loop {
            let ready = poll(&mut [PollFd::new(&self.0, PollFlags::IN)], Some(&patience));
            assert_eq!(ready, Ok(1), "no modem frame came");
            self.0.read_exact(&mut byte).unwrap();
            match byte {
                [0] => break,
                [byte] => framed.push(byte),
            }
        }
        cobs::decode_vec(&framed).unwrap()
    }
}

/// Modem frames come over a serial line with noise between them, reports go back. The modem is unplugged, and plugged
/// in again.
#[test]
fn a_modem_on_a_serial_line_is_spoken_to_and_waited_for() {
    let dive = Dive::new();
    dive.encode("--psnr 40 --limit 2");
    let frames = |packet: u32| {
        let folder = format!("frames{packet}");
        dive.run(&format!("split packets/{packet}.nvsp --out {folder} --mtu 64")).ends_with(0);
        let mut files: Vec<_> = std::fs::read_dir(dive.path(&folder))
            .unwrap()
            .map(|file| file.unwrap().path())
            .collect();
        files.sort();
        files.into_iter().map(|file| std::fs::read(file).unwrap()).collect::<Vec<_>>()
    };
    let [first, second] = [0, 1].map(frames);
    let mut modem = Modem::plug_in(&dive);
    let console = Console::start(&dive, "--serial tty,19200");
    for frame in &first {
        modem.0.write_all(&[7, 200, 0, 0, 3, 0]).unwrap();
        modem.send(frame);
    }
    let state = console.until("a picture", |state| state["picture"]["complete"] == true);
    assert!(state["link"]["garbage"].as_u64() >= Some(2), "{state:#}");
    let (report, _) = nvsprior_link::modem::Report::read(&modem.receive()).unwrap();
    assert!(report.packets().next().is_some(), "it tells of the packet");

    drop(modem);
    let state = console.until("that it is gone", |state| state["stopped"].is_string());
    assert!(state["stopped"].as_str().unwrap().starts_with("tty: "), "{state:#}");
    let number = state["picture"]["number"].as_u64().unwrap();
    let mut modem = Modem::plug_in(&dive);
    console.until("that it is there again", |state| state["stopped"].is_null());
    second.iter().for_each(|frame| modem.send(frame));
    console.until_picture(number + 1);
    assert!(nvsprior_link::modem::Report::read(&modem.receive()).is_ok(), "to the new device");
}
