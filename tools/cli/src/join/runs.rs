//! Packets in folders, one for each run of the vehicle.
//!
//! A vehicle that starts anew counts its frames from 0. A packet whose number was there before with other bytes is the
//! sign of it. Numbers that begin anew after 65,535 are none, nor are packets that come late, or twice.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use nvsprior::packet::nearest_frame;
use nvsprior_link::modem::{
    Collected, CollectedPacket, Collector, CollectorOptions, MIN_CHECKED_MTU, ModemError,
    largest_packet, share_count,
};
use nvsprior_runs::{FrameFolder, FrameKind, remove_own};

/// Packets that are held, as many as can be: packets of files may come in any order of their numbers.
const HELD: usize = 64;
/// Seconds after which none of them is held any more.
const APART: f64 = 60.0;
/// The longest packet, bytes.
const MAX_BYTES: usize = 1 << 16;
/// What packets count their frames to.
const NUMBERS: u32 = 1 << 16;

/// Frames of one count of numbers.
pub struct Gathering {
    collector: Collector,
    /// When frames come, seconds.
    now: f64,
}

/// What a frame is.
#[derive(Clone, Copy, PartialEq)]
enum Pushed {
    Refused,
    Taken,
    /// The packet of this number is whole.
    Complete(u32),
    /// The packet's own checks do not match; what was written of it may be wrong.
    Damaged,
}

impl Gathering {
    fn new(mtu: usize) -> Result<Gathering, ModemError> {
        let shares = share_count(MAX_BYTES.min(largest_packet(mtu)?), mtu)?;
        let options = CollectorOptions { shares, packets: HELD, ..CollectorOptions::new(mtu) };
        Ok(Gathering { collector: Collector::new(options)?, now: 0.0 })
    }

    /// The complete packets that frames yield.
    pub fn complete(frames: &[Vec<u8>], mtu: usize) -> Result<BTreeSet<Vec<u8>>, ModemError> {
        let (mut gathering, mut complete) = (Gathering::new(mtu)?, BTreeSet::new());
        for frame in frames {
            if let Pushed::Complete(number) = gathering.push(frame) {
                let packet = gathering.collector.packet(0, number);
                complete.extend(packet.map(|packet| packet.bytes.to_vec()));
            }
        }
        Ok(complete)
    }

    fn push(&mut self, frame: &[u8]) -> Pushed {
        let mut pushed = self.collector.push(self.now, frame);
        if matches!(pushed, Err(ModemError::Late(_))) {
            // Files may come in any order.
            self.now += APART;
            pushed = self.collector.push(self.now, frame);
        }
        match pushed {
            Err(_) => Pushed::Refused,
            Ok(Collected::Complete(_, number)) => Pushed::Complete(number),
            Ok(Collected::Damaged(..)) => Pushed::Damaged,
            Ok(_) => Pushed::Taken,
        }
    }

    fn packets(&self) -> impl Iterator<Item = CollectedPacket<'_>> {
        let newest = self.collector.newest(0).map(|packet| packet.frame);
        let back = |newest: u32| (0..HELD as u32).map(move |k| newest.wrapping_sub(k));
        newest.into_iter().flat_map(back).filter_map(|number| self.collector.packet(0, number))
    }
}

/// A run of the vehicle, from its first frame to its last.
pub struct Run {
    pub folder: PathBuf,
    files: FrameFolder,
    /// Bytes written of each frame number, and whether they are all.
    pub packets: BTreeMap<u32, (usize, bool)>,
    /// Numbers that came since the greatest one.
    since: BTreeSet<u32>,
}

impl Run {
    fn new(folder: &Path, overwrite: bool) -> anyhow::Result<Run> {
        let files = FrameFolder::open("--out", folder, FrameKind::PACKET, overwrite)?;
        let (packets, since) = (BTreeMap::new(), BTreeSet::new());
        Ok(Run { folder: folder.to_path_buf(), files, packets, since })
    }

    pub fn complete(&self) -> usize {
        self.packets.values().filter(|(_, complete)| *complete).count()
    }

    fn newest(&self) -> Option<u32> {
        self.packets.last_key_value().map(|(number, _)| *number)
    }

    fn read(&self, number: u32) -> anyhow::Result<Option<Vec<u8>>> {
        let read = || self.files.read(&name(number));
        self.packets.contains_key(&number).then(read).transpose().context("reading a packet again")
    }

    /// Writes the packets that have come or grown. `damaged`: what is known of one may be less than before.
    fn write(&mut self, gathering: &Gathering, damaged: bool) -> anyhow::Result<()> {
        for packet in gathering.packets() {
            let (number, known) = (packet.frame, (packet.bytes.len(), packet.complete));
            if self.packets.get(&number) == Some(&known) {
                continue;
            }
            let longer = self.packets.get(&number).is_some_and(|(len, _)| *len > known.0);
            if longer && !damaged && starts(self.read(number)?, packet.bytes) {
                // Its start has come again.
                continue;
            }
            if self.newest().is_none_or(|newest| newest < number) {
                self.since.clear();
            } else if !self.packets.contains_key(&number) {
                self.since.insert(number);
            }
            self.files.write_again(&name(number), packet.bytes)?;
            self.packets.insert(number, known);
        }
        Ok(())
    }

    /// Whether a packet is another one than that of its number; `None` if there is none.
    fn differs(&self, packet: &CollectedPacket<'_>) -> anyhow::Result<Option<bool>> {
        let number = nearest_frame(packet.frame % NUMBERS, NUMBERS, self.newest());
        let own = self.read(number)?;
        Ok(own.map(|own| !own.starts_with(packet.bytes) && !packet.bytes.starts_with(&own)))
    }

    /// Gives up what came since its greatest number and is of the next run.
    fn give_up(&mut self, next: &Gathering) -> anyhow::Result<()> {
        for packet in next.packets() {
            let number = nearest_frame(packet.frame % NUMBERS, NUMBERS, self.newest());
            if self.since.contains(&number) && self.differs(&packet)? == Some(false) {
                self.files.remove(&name(number))?;
                self.packets.remove(&number);
            }
        }
        Ok(())
    }
}

fn starts(longer: Option<Vec<u8>>, bytes: &[u8]) -> bool {
    longer.is_some_and(|longer| longer.starts_with(bytes))
}

fn hash(frame: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    hasher.write(frame);
    hasher.finish()
}

fn name(number: u32) -> String {
    format!("{number:08}.nvsp")
}

/// The runs that frames belong to.
pub struct Runs {
    mtu: usize,
    out: PathBuf,
    overwrite: bool,
    current: Gathering,
    /// The frames since the greatest number, by themselves: they may be of a new run.
    next: Option<Gathering>,
    runs: Vec<Run>,
    /// Hashes of the frames that came.
    seen: HashSet<u64>,
    refused: usize,
}

impl Runs {
    pub fn new(mtu: usize, out: &Path, overwrite: bool) -> anyhow::Result<Runs> {
        let current = Gathering::new(mtu)?;
        let runs = vec![Run::new(out, overwrite)?];
        let (out, seen) = (out.to_owned(), HashSet::new());
        Ok(Runs { mtu, out, overwrite, current, next: None, runs, seen, refused: 0 })
    }

    /// Frames that were none, or damaged.
    pub fn refused(&self) -> usize {
        self.refused
    }

    /// Takes a frame, and writes each packet that it adds to. What is no frame is counted, and left out.
    pub fn push(&mut self, frame: &[u8]) -> anyhow::Result<()> {
        // What came before, in whichever run, begins none.
        let is_new = self.seen.insert(hash(frame));
        let pushed = self.current.push(frame);
        let run = self.runs.last_mut().context("no run")?;
        let before = run.newest();
        if pushed != Pushed::Refused {
            run.write(&self.current, pushed == Pushed::Damaged)?;
        }
        if run.newest() > before {
            self.next = None;
            return Ok(());
        }
        // Small frames count to 8: a restart cannot be told from frames that were lost.
        let can_tell = self.mtu >= MIN_CHECKED_MTU && before.is_some() && is_new;
        let mut also = Pushed::Refused;
        if can_tell {
            let next = self.next.take().map_or_else(|| Gathering::new(self.mtu), Ok);
            also = self.next.insert(next?).push(frame);
            self.begin_anew()?;
        }
        self.refused += usize::from((pushed, also) == (Pushed::Refused, Pushed::Refused));
        Ok(())
    }

    /// Begins a new run if the frames since the greatest number yield another packet of a number that is there.
    fn begin_anew(&mut self) -> anyhow::Result<()> {
        let Some(next) = &self.next else { return Ok(()) };
        let (run, mut is_new) = (self.runs.last().context("no run")?, false);
        for packet in next.packets() {
            is_new |= run.differs(&packet)? == Some(true);
        }
        let Some(next) = self.next.take_if(|_| is_new) else { return Ok(()) };
        self.runs.last_mut().context("no run")?.give_up(&next)?;
        let mut run = Run::new(&self.folder(self.runs.len() + 1), true)?;
        run.write(&next, false)?;
        tell!("frame numbers begin anew: the packets from here on are in {}", run.folder.display());
        self.current = next;
        self.runs.push(run);
        Ok(())
    }

    /// The folder of a run after the first.
    fn folder(&self, number: usize) -> PathBuf {
        self.out.join(number.to_string())
    }

    /// All frames have come.
    pub fn finish(mut self) -> anyhow::Result<Vec<Run>> {
        for run in &mut self.runs {
            run.files.finish()?;
        }
        // Of an earlier command that had more runs.
        let more = (self.runs.len() + 1..).map(|number| self.folder(number));
        for folder in more.take_while(|folder| self.overwrite && folder.is_dir()) {
            remove_own(&folder, FrameKind::PACKET).with_context(|| folder.display().to_string())?;
        }
        Ok(self.runs)
    }
}
