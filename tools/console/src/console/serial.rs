//! A serial line. A device that is unplugged is waited for.

use std::io::Write;
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use serialport::SerialPort;

use super::clock::Clock;
use super::event::Event;
use super::framed::{framed, take_framed};

/// Longest time that one read or write may take.
const PATIENCE: Duration = Duration::from_secs(1);
/// Time between two looks for a device that is gone.
const AGAIN: Duration = Duration::from_millis(500);

#[derive(Debug, thiserror::Error)]
#[error("--serial {device}: it cannot be opened: {cause}; is it plugged in, and may you use it?")]
pub struct SerialError {
    device: String,
    cause: serialport::Error,
}

/// A line that is open, and not read yet.
pub struct SerialLine {
    device: String,
    baud: u32,
    port: Box<dyn SerialPort>,
    writer: SerialWriter,
}

/// Sends over a line. While the device is gone, nothing is sent.
#[derive(Clone, Default)]
pub struct SerialWriter(Arc<Mutex<Option<Box<dyn SerialPort>>>>);

impl SerialWriter {
    fn set(&self, port: Option<Box<dyn SerialPort>>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = port;
    }

    /// Sends a modem frame.
    pub fn send(&self, bytes: &[u8]) -> std::io::Result<()> {
        match &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner) {
            Some(port) => port.write_all(&framed(bytes)),
            None => Ok(()),
        }
    }
}

impl SerialLine {
    pub fn open(device: &str, baud: u32) -> Result<SerialLine, SerialError> {
        let (device, writer) = (device.to_owned(), SerialWriter::default());
        match open(&device, baud, &writer) {
            Ok(port) => Ok(SerialLine { device, baud, port, writer }),
            Err(cause) => Err(SerialError { device, cause }),
        }
    }

    pub fn writer(&self) -> SerialWriter {
        self.writer.clone()
    }

    /// Takes modem frames, until the topside ends.
    pub fn take(self, clock: Clock, mtu: usize, events: &SyncSender<Event>) -> Option<String> {
        let SerialLine { device, baud, mut port, writer } = self;
        loop {
            let why = take_framed(&mut port, clock, mtu, events)?;
            // A name is free for the device that is plugged in again once nothing holds the old one.
            drop(port);
            writer.set(None);
            let stopped = Event::Stopped(format!("{device}: {why}. The device is waited for"));
            events.send(stopped).ok()?;
            port = loop {
                std::thread::sleep(AGAIN);
                if let Ok(port) = open(&device, baud, &writer) {
                    break port;
                }
            };
            events.send(Event::Resumed).ok()?;
        }
    }
}

/// Opens a device, and has the writer use it, too.
fn open(
    device: &str,
    baud: u32,
    writer: &SerialWriter,
) -> Result<Box<dyn SerialPort>, serialport::Error> {
    let port = serialport::new(device, baud).timeout(PATIENCE).open()?;
    writer.set(Some(port.try_clone()?));
    Ok(port)
}
