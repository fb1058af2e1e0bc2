//! What a topside tells its vehicle: which packets came, what of others, and user bytes.
//!
//! A report is one modem frame. It is for links with a return channel. From it a vehicle learns the loss, which shares
//! to send again, and which frames later ones may be predicted from. A lost report costs little: the next one tells of
//! the same packets, as long as they are recent. Numbers are little endian.
//!
//! The bytes: `docs/format/modem.md`.
//!
//! States: 0 nothing came; 1 shares came, but not all of the packet; 2 the packet is whole; 3 its picture was decoded
//! in full, too. Padding may follow. Of an unprotected packet the first 256 shares are listed; until its length has
//! come, those up to the first missing one.
//!
//! *Poses*: the frames whose poses the topside holds.

use nvsprior::packet::crc16;

use super::error::ModemError;
use super::limits::{MAX_SHARES, STREAMS};
use super::reported_poses::ReportedPoses;

/// Most packets that a report tells of.
pub const MAX_REPORTED: usize = 32;
/// Most user bytes.
const MAX_USER: usize = 255;
/// The frame number in a report is modulo this.
const NUMBERS: u32 = 1 << 16;
/// The first byte's bits, without those of the stream and of what follows.
const MARK: u8 = 0b0000_0100;
const STREAM_SHIFT: u8 = 4;
const USER: u8 = 1;
const POSES: u8 = 2;
/// Where the fourth byte has the number of bytes of poses, less one.
const POSE_SHIFT: u8 = 6;
/// Largest number of shares that a packet's byte holds.
pub(super) const MAX_ARRIVED: u8 = 63;
/// Bytes before the packets'.
const HEAD: usize = 4;
const CHECK: usize = 2;

/// What came of a packet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PacketState {
    /// Nothing, or the frame was left out.
    #[default]
    Nothing,
    /// Shares, but not all of the packet.
    Part,
    /// All of it.
    Whole,
    /// All of it, and its picture was decoded in full: [`Decoded::kept`](nvsprior::Decoded::kept). Later frames may be
    /// predicted from it.
    Kept,
}

/// The shares of a packet that came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ArrivedShares {
    count: u16,
    bits: [u8; MAX_SHARES / 8],
}

impl ArrivedShares {
    /// Of a packet that was sent in `count` shares, 1 to 256. Indices beyond them are ignored.
    pub fn new(count: usize, arrived: impl Iterator<Item = usize>) -> ArrivedShares {
        let count = count.min(MAX_SHARES);
        let mut shares = ArrivedShares { count: count as u16, bits: [0; MAX_SHARES / 8] };
        for index in arrived.filter(|index| *index < count) {
            shares.bits[index / 8] |= 1 << (index % 8);
        }
        shares
    }

    /// Whether a share came.
    pub fn contains(&self, index: usize) -> bool {
        index < self.sent() && self.bits[index / 8] >> (index % 8) & 1 == 1
    }

    /// Shares that the packet was sent in.
    pub fn sent(&self) -> usize {
        self.count.into()
    }

    /// Number of those that came.
    pub fn arrived(&self) -> usize {
        self.bits.iter().map(|byte| byte.count_ones() as usize).sum()
    }

    /// The bytes that have a bit for each share.
    fn bytes(&self) -> &[u8] {
        &self.bits[..self.sent().div_ceil(8)]
    }
}

/// A packet, as a report tells of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReportedPacket {
    /// What came of it.
    pub state: PacketState,
    /// Shares of it that came. In a report that was read, 63 stands for more, too.
    pub arrived: usize,
    /// Which ones, of [`PacketState::Part`].
    pub shares: ArrivedShares,
}

/// What a topside tells its vehicle of a stream's packets.
///
/// A topside makes it with [`Collector::report`](crate::modem::Collector::report) and sends [`Report::write`]'s bytes.
/// A vehicle reads it with [`Report::read`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    stream: u8,
    newest: u32,
    reported: usize,
    packets: [ReportedPacket; MAX_REPORTED],
    /// `None`: it tells nothing of poses.
    poses: Option<ReportedPoses>,
}

impl Report {
    /// Of the packet of a stream's newest frame number, and of those before it. `packets`: newest first, without gaps;
    /// those beyond [`MAX_REPORTED`] are left out.
    ///
    /// # Errors
    /// If the stream is not 0 to 3.
    pub fn new(
        stream: u8,
        newest: u32,
        packets: impl Iterator<Item = ReportedPacket>,
    ) -> Result<Report, ModemError> {
        if stream >= STREAMS {
            return Err(ModemError::Stream(stream));
        }
        let newest = newest % NUMBERS;
        let packets_told = Default::default();
        let mut report = Report { stream, newest, reported: 0, packets: packets_told, poses: None };
        for packet in packets.take(MAX_REPORTED) {
            report.packets[report.reported] = packet;
            report.reported += 1;
        }
        Ok(report)
    }

    /// The stream that it is about.
    pub fn stream(&self) -> u8 {
        self.stream
    }

    /// The newest frame number of which a share came, modulo 2¹⁶.
    pub fn newest(&self) -> u32 {
        self.newest
    }

    /// The packet of a frame number, of which only the low 16 bits count. `None`: the report does not tell of it.
    pub fn packet(&self, frame: u32) -> Option<&ReportedPacket> {
        let behind = self.newest.wrapping_sub(frame) % NUMBERS;
        self.packets[..self.reported].get(behind as usize)
    }

    /// Tells the vehicle the poses of which frames the topside holds, of the last 32:
    /// [`Decoder::holds_pose`](nvsprior::Decoder::holds_pose). Later poses are then predicted from them.
    pub fn tell_poses(&mut self, holds: impl Fn(u32) -> bool) {
        self.poses = Some(ReportedPoses::new(self.newest, holds));
    }

    /// Frame numbers modulo 2¹⁶, newest first, and whether the topside holds their poses, for
    /// [`Encoder::acknowledge_pose`](nvsprior::Encoder::acknowledge_pose). None if the report does not tell.
    pub fn poses(&self) -> impl Iterator<Item = (u32, bool)> {
        self.poses.into_iter().flat_map(|poses| poses.each(self.newest))
    }

    /// The packets, newest first, with their frame numbers modulo 2¹⁶.
    pub fn packets(&self) -> impl Iterator<Item = (u32, &ReportedPacket)> {
        let numbers = (0..).map(|behind| self.newest.wrapping_sub(behind) % NUMBERS);
        numbers.zip(&self.packets[..self.reported])
    }

    /// Writes the report with user bytes, and returns its length. `into` has as many bytes as a modem frame may have.
    /// If not all fits, it tells of the newest packets.
    ///
    /// # Errors
    /// If there are more than 255 user bytes, or the report does not fit even without packets.
    pub fn write(&self, user: Option<&[u8]>, into: &mut [u8]) -> Result<usize, ModemError> {
        let mtu = into.len();
        let user_len = user.map_or(0, |user| 1 + user.len());
        if user_len > 1 + MAX_USER {
            return Err(ModemError::UserBytes(user_len - 1));
        }
        let needed = HEAD + user_len + CHECK;
        let room = mtu.checked_sub(needed).ok_or(ModemError::ReportMtu { mtu, needed })?;
        let poses = self.poses.and_then(|poses| poses.within(room));
        let room = room - poses.map_or(0, |poses| poses.len());
        let reported = &self.packets[..self.fitting(room)];
        let mut bytes = ReportWriter { into, len: 0 };
        let mark = MARK | self.stream << STREAM_SHIFT | if user.is_some() { USER } else { 0 };
        let mark = mark | if poses.is_some() { POSES } else { 0 };
        let [low, high, ..] = self.newest.to_le_bytes();
        let pose_bytes = poses.map_or(0, |poses| (poses.len() - 1) as u8);
        bytes.add(&[mark, low, high, pose_bytes << POSE_SHIFT | reported.len() as u8]);
        for packet in reported {
            let arrived = packet.arrived.min(MAX_ARRIVED.into()) as u8;
            bytes.add(&[packet.state as u8 | arrived << 2]);
        }
        for packet in reported.iter().filter(|packet| packet.lists_shares()) {
            bytes.add(&[(packet.shares.sent() - 1) as u8]);
            bytes.add(packet.shares.bytes());
        }
        poses.iter().flat_map(|poses| poses.bytes()).for_each(|byte| bytes.add(&[byte]));
        if let Some(user) = user {
            bytes.add(&[user.len() as u8]);
            bytes.add(user);
        }
        let check = crc16(&[&bytes.into[..bytes.len]]);
        bytes.add(&check.to_le_bytes());
        Ok(bytes.len)
    }

    /// How many packets fit so many bytes.
    fn fitting(&self, room: usize) -> usize {
        let lens = self.packets[..self.reported].iter().scan(0, |len, packet| {
            *len += 1 + if packet.lists_shares() { 1 + packet.shares.bytes().len() } else { 0 };
            Some(*len)
        });
        lens.take_while(|len| *len <= room).count()
    }

    /// Reads a report, and the user bytes that came with it. Padding may follow.
    ///
    /// # Errors
    /// If the bytes are no report, are cut, or their check does not match.
    pub fn read(bytes: &[u8]) -> Result<(Report, Option<&[u8]>), ModemError> {
        let mut rest = Rest { all: bytes, at: 0 };
        let mark = rest.byte()?;
        if mark & !(POSES | USER | 3 << STREAM_SHIFT) != MARK {
            return Err(ModemError::NotAFrame(mark));
        }
        let newest = u32::from(rest.byte()?) | u32::from(rest.byte()?) << 8;
        let counts = rest.byte()?;
        let (reported, poses) = (usize::from(counts & 0x3F), usize::from(counts >> POSE_SHIFT));
        if mark & POSES == 0 && poses > 0 {
            return Err(ModemError::NotAFrame(mark));
        }
        let states = rest.take(reported)?;
        let mut report = Report {
            stream: mark >> STREAM_SHIFT & 3,
            newest,
            reported,
            packets: Default::default(),
            poses: None,
        };
        let packets = report.packets.get_mut(..reported).ok_or(ModemError::NotAFrame(mark))?;
        for (packet, state) in packets.iter_mut().zip(states) {
            packet.state = match state & 3 {
                0 => PacketState::Nothing,
                1 => PacketState::Part,
                2 => PacketState::Whole,
                _ => PacketState::Kept,
            };
            packet.arrived = usize::from(state >> 2);
            if packet.state == PacketState::Part {
                packet.shares = rest.shares()?;
            }
        }
        if mark & POSES != 0 {
            report.poses = Some(ReportedPoses::read(rest.take(poses + 1)?));
        }
        let user = match mark & USER {
            0 => None,
            _ => {
                let len = rest.byte()?.into();
                Some(rest.take(len)?)
            }
        };
        let check = crc16(&[&bytes[..rest.at]]);
        let found = [rest.byte()?, rest.byte()?];
        match u16::from_le_bytes(found) == check {
            true => Ok((report, user)),
            false => Err(ModemError::ReportCheck),
        }
    }
}

impl ReportedPacket {
    /// Whether a report lists its shares one by one.
    fn lists_shares(&self) -> bool {
        self.state == PacketState::Part && self.shares.sent() > 0
    }
}

/// What is written so far. There is room for all: see [`Report::fitting`].
struct ReportWriter<'a> {
    into: &'a mut [u8],
    len: usize,
}

impl ReportWriter<'_> {
    fn add(&mut self, bytes: &[u8]) {
        self.into[self.len..][..bytes.len()].copy_from_slice(bytes);
        self.len += bytes.len();
    }
}

/// What is not read yet.
struct Rest<'a> {
    all: &'a [u8],
    at: usize,
}

impl<'a> Rest<'a> {
    fn take(&mut self, len: usize) -> Result<&'a [u8], ModemError> {
        let end = self.at + len;
        let cut = ModemError::Cut { found: self.all.len(), needed: end };
        let taken = self.all.get(self.at..end).ok_or(cut)?;
        self.at = end;
        Ok(taken)
    }

    fn byte(&mut self) -> Result<u8, ModemError> {
        Ok(self.take(1)?[0])
    }

    fn shares(&mut self) -> Result<ArrivedShares, ModemError> {
        let count = usize::from(self.byte()?) + 1;
        let bytes = self.take(count.div_ceil(8))?;
        Ok(ArrivedShares::new(count, (0..count).filter(|k| bytes[k / 8] >> (k % 8) & 1 == 1)))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn report() -> Report {
        let part = ReportedPacket {
            state: PacketState::Part,
            arrived: 2,
            shares: ArrivedShares::new(9, [0, 8].into_iter()),
        };
        let of = |state, arrived| ReportedPacket { state, arrived, ..Default::default() };
        let packets = [
            part,
            of(PacketState::Kept, 9),
            of(PacketState::Nothing, 0),
            of(PacketState::Whole, 8),
        ];
        Report::new(2, 0x1_0001, packets.into_iter()).unwrap()
    }

    fn written(mtu: usize, user: Option<&[u8]>) -> Vec<u8> {
        bytes_of(&report(), mtu, user)
    }

    fn bytes_of(report: &Report, mtu: usize, user: Option<&[u8]>) -> Vec<u8> {
        let mut bytes = vec![0; mtu];
        let len = report.write(user, &mut bytes).unwrap();
        bytes.truncate(len);
        bytes
    }

    #[test]
    fn poses_are_told_as_far_as_there_is_room() {
        let mut with = report();
        with.tell_poses(|frame| frame as u16 != 0xFFFF);
        let bytes = bytes_of(&with, 80, Some(b"user"));
        assert_eq!(bytes.len(), bytes_of(&report(), 80, Some(b"user")).len() + 4);
        let (read, user) = Report::read(&bytes).unwrap();
        assert_eq!((read, user), (with, Some(&b"user"[..])));
        let poses: Vec<_> = read.poses().take(4).collect();
        assert_eq!(poses, [(1, true), (0, true), (0xFFFF, false), (0xFFFE, true)]);
        assert_eq!(report().poses().count(), 0);
        // The smallest modem frame has room for those of eight frames.
        let (small, _) = Report::read(&bytes_of(&with, 8, None)).map(|(r, _)| (r, ())).unwrap();
        assert_eq!(small.poses().count(), 8);
    }

    #[test]
    fn what_is_written_is_read() {
        for user in [None, Some(&b""[..]), Some(b"depth 31.4")] {
            let mut bytes = written(64, user);
            assert_eq!(Report::read(&bytes), Ok((report(), user)));
            bytes.extend([0; 40]);
            assert_eq!(Report::read(&bytes), Ok((report(), user)), "padded");
        }
    }

    #[test]
    fn a_packet_is_found_by_its_number() {
        let report = report();
        assert_eq!((report.stream(), report.newest()), (2, 1));
        assert!(report.packet(1).unwrap().shares.contains(8));
        assert_eq!(report.packet(0).unwrap().state, PacketState::Kept);
        assert_eq!(report.packet(0xFFFF).unwrap().state, PacketState::Nothing);
        assert_eq!(report.packet(0x2_FFFE).unwrap().arrived, 8);
        assert_eq!(report.packet(0xFFFD), None);
        assert_eq!(report.packet(2), None, "newer ones are not in it");
        let numbers: Vec<_> = report.packets().map(|(number, _)| number).collect();
        assert_eq!(numbers, [1, 0, 0xFFFF, 0xFFFE]);
    }

    #[test]
    fn a_small_mtu_takes_the_newest_packets() {
        // A head of four bytes, four for the newest packet, and two of check.
        let (read, _) = Report::read(&written(11, None)).map(|(read, _)| (read, ())).unwrap();
        assert_eq!(read.packets().count(), 2);
        let refused = report().write(Some(b"abc"), &mut [0; 8]);
        assert_eq!(refused, Err(ModemError::ReportMtu { mtu: 8, needed: 10 }));
        let many = report().write(Some(&[0; 256]), &mut [0; 1000]);
        assert_eq!(many, Err(ModemError::UserBytes(256)));
    }

    #[test]
    fn damage_is_found() {
        let bytes = bytes_of(&report(), 64, Some(b"user"));
        for bit in 0..8 * bytes.len() {
            let mut damaged = bytes.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(Report::read(&damaged).is_err(), "bit {bit}");
        }
        for len in 0..bytes.len() {
            assert!(Report::read(&bytes[..len]).is_err(), "cut to {len}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            if let Ok((report, user)) = Report::read(&bytes) {
                let mut again = [0; 2048];
                let len = report.write(user, &mut again).unwrap();
                prop_assert_eq!(Report::read(&again[..len]), Ok((report, user)));
            }
        }
    }
}
