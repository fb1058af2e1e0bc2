//! `nvsprior channel`: the simulated link as a relay of datagrams.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::net::{SocketAddr, UdpSocket};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use anyhow::Context;
use nvsprior_channel::channel::{Channel, ChannelOptions};
use nvsprior_inputs::values::{self, WrongUsage};
use nvsprior_link::modem::Loss;

use crate::endpoint::{self, DATAGRAM};

/// Carry datagrams as an acoustic link would
///
/// Takes the vehicle's datagrams at --from and gives them to the topside at --to. They go one after another at
/// --bit-rate, take --delay, and some are lost. What comes back from the topside goes in the same way to whoever sent
/// last. It runs until it is stopped.
#[derive(clap::Args)]
pub struct Args {
    /// UDP port that the vehicle sends to; with ADDRESS:PORT on that address alone
    #[arg(long, value_name = "PORT", value_parser = endpoint::local)]
    from: SocketAddr,
    /// Where the topside listens
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = endpoint::remote)]
    to: SocketAddr,
    /// Bits per second, in each direction
    #[arg(long, value_name = "BPS", default_value_t = 5000.0, value_parser = values::rate)]
    bit_rate: f64,
    /// Chance that a datagram is lost, 0 up to but not 1
    #[arg(long, value_name = "X", default_value_t = 0.0, value_parser = values::not_negative)]
    loss: f64,
    /// Mean number of datagrams that are lost in a row
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = values::not_negative)]
    burst: f64,
    /// Seconds from one end to the other
    #[arg(long, value_name = "S", default_value_t = 0.1, value_parser = values::seconds)]
    delay: f64,
    /// What a datagram takes beside its bytes, as bytes
    #[arg(long, value_name = "BYTES", default_value_t = 0, value_parser = values::count)]
    overhead: usize,
    /// Seed of the losses
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// Datagrams on their way, at most; more are dropped, as by a modem whose buffer is full.
const MOST: usize = 4096;

/// A datagram from one of the ends.
enum Came {
    FromVehicle(Vec<u8>, SocketAddr),
    FromTopside(Vec<u8>),
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let loss = Loss { chance: args.loss, burst: args.burst.max(1.0) };
    loss.check().map_err(|error| WrongUsage(format!("--loss, --burst: {error}")))?;
    let vehicle = endpoint::listen(args.from)?;
    let topside = endpoint::connect(args.to)?;
    let at = vehicle.local_addr().context("reading the port")?;
    say!(
        "channel: from {at} to {}, {} bit/s, {} % lost, {} s",
        args.to,
        args.bit_rate,
        args.loss * 100.0,
        args.delay
    );
    let channel = |seed| {
        Channel::new(ChannelOptions {
            bit_rate: args.bit_rate,
            overhead: args.overhead,
            propagation: args.delay,
            loss,
            reorder: 0.0,
            blackout: [0.0; 2],
            seed,
        })
    };
    let (sender, came) = sync_channel(MOST);
    take_from(vehicle.try_clone().context("--from")?, sender.clone(), Came::FromVehicle);
    take_from(topside.try_clone().context("--to")?, sender, |bytes, _| Came::FromTopside(bytes));
    // Each direction has losses of its own.
    let channels = [channel(args.seed), channel(!args.seed)];
    Relay {
        start: Instant::now(),
        vehicle,
        topside,
        channels,
        peer: None,
        waiting: BinaryHeap::new(),
    }
    .carry(&came)
}

/// Takes the datagrams of a socket on a thread of its own.
fn take_from(
    socket: UdpSocket,
    sender: SyncSender<Came>,
    as_came: impl Fn(Vec<u8>, SocketAddr) -> Came + Send + 'static,
) {
    std::thread::spawn(move || {
        let mut buffer = vec![0; DATAGRAM];
        loop {
            match endpoint::receive(&socket, Some(Duration::from_secs(60)), &mut buffer) {
                Ok(None) => {}
                // If there is no room, it is dropped.
                Ok(Some((bytes, from))) => drop(sender.try_send(as_came(bytes.to_vec(), from))),
                Err(error) => {
                    tell!("channel: {error}");
                    std::thread::sleep(Duration::from_secs(1));
                }
            }
        }
    });
}

/// A datagram that arrives at a time.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Waiting {
    arrives: Duration,
    /// In the order in which they came, if they arrive at once.
    order: u64,
    to_vehicle: bool,
    bytes: Vec<u8>,
}

struct Relay {
    start: Instant,
    vehicle: UdpSocket,
    topside: UdpSocket,
    /// To the topside, to the vehicle.
    channels: [Channel; 2],
    /// Who sent last.
    peer: Option<SocketAddr>,
    waiting: BinaryHeap<Reverse<Waiting>>,
}

impl Relay {
    fn carry(mut self, came: &Receiver<Came>) -> anyhow::Result<()> {
        let mut order = 0;
        loop {
            let now = self.start.elapsed();
            while self.waiting.peek().is_some_and(|next| next.0.arrives <= now) {
                let Some(Reverse(arrived)) = self.waiting.pop() else { break };
                self.deliver(&arrived);
            }
            let until = self.waiting.peek().map_or(Duration::from_secs(1), |next| {
                next.0.arrives.saturating_sub(self.start.elapsed())
            });
            match came.recv_timeout(until) {
                Ok(datagram) => self.take(datagram, order),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => anyhow::bail!("both sockets are closed"),
            }
            order += 1;
        }
    }

    fn take(&mut self, datagram: Came, order: u64) {
        let (bytes, to_vehicle) = match datagram {
            Came::FromVehicle(bytes, from) => {
                self.peer = Some(from);
                (bytes, false)
            }
            Came::FromTopside(bytes) => (bytes, true),
        };
        if self.waiting.len() >= MOST {
            return;
        }
        let now = self.start.elapsed().as_secs_f64();
        let sent = self.channels[usize::from(to_vehicle)].send(now, bytes.len());
        if let Some(arrival) = sent.arrival {
            let arrives = Duration::from_secs_f64(arrival);
            self.waiting.push(Reverse(Waiting { arrives, order, to_vehicle, bytes }));
        }
    }

    /// That nobody listens is no failure.
    fn deliver(&self, arrived: &Waiting) {
        let _ = match (arrived.to_vehicle, self.peer) {
            (false, _) => self.topside.send(&arrived.bytes),
            (true, Some(peer)) => self.vehicle.send_to(&arrived.bytes, peer),
            (true, None) => Ok(0),
        };
    }
}
