//! A packet that was read, without its bytes: so it may be kept beside them, and is read once.

use super::error::PacketError;
use super::head::PoseKind;
use super::held::HeldPoses;
use super::latent::{Latent, Layout, Read};
use super::render::{self, RenderCheck};
use super::residual::{Contents, Residual, ResidualStart};
use super::session::{self, Session};

/// What a packet holds, and where: all that is valid in it, and why the rest is not.
#[derive(Clone, Debug)]
pub struct Parsed {
    read: Read,
    session: Result<Option<Session>, PacketError>,
    render: Result<Option<RenderCheck>, PacketError>,
    found: Contents,
}

impl Parsed {
    /// Reads what is valid in a truncated or damaged packet.
    ///
    /// # Errors
    /// If the latent part is not valid, or its pose is predicted: the packet is then of no use.
    pub fn of(bytes: &[u8]) -> Result<Parsed, PacketError> {
        Parsed::with(bytes, &HeldPoses::default())
    }

    /// As [`Parsed::of`], with the poses that the packet's may be predicted from.
    pub fn with(bytes: &[u8], held: &HeldPoses) -> Result<Parsed, PacketError> {
        Ok(Parsed::behind(held.read(bytes)?, bytes))
    }

    /// Reads the parts behind a latent part. The first two have fixed lengths, so damage in them does not hide those
    /// after them.
    fn behind(read: Read, bytes: &[u8]) -> Parsed {
        let Read { latent, head, len } = read;
        let rest = |at: usize| bytes.get(at..).unwrap_or(&[]);
        let mut at = len;
        let session =
            if head.session { Session::read(rest(at), latent.tag).map(Some) } else { Ok(None) };
        at += if head.session { session::LEN } else { 0 };
        let render =
            if head.render { render::decode(rest(at), &bytes[..len]).map(Some) } else { Ok(None) };
        at += if head.render { render::LEN } else { 0 };
        let found = Contents::read(&head, bytes, len, at);
        Parsed { read, session, render, found }
    }

    /// The latent part: valid, or there would be nothing.
    pub fn latent(&self) -> &Latent {
        &self.read.latent
    }

    /// Length of the latent part, bytes.
    pub fn latent_len(&self) -> usize {
        self.read.len
    }

    /// The session part; `None` if none was sent.
    pub fn session(&self) -> &Result<Option<Session>, PacketError> {
        &self.session
    }

    /// The render part; `None` if none was sent.
    pub fn render(&self) -> &Result<Option<RenderCheck>, PacketError> {
        &self.render
    }

    /// The residual, of the bytes that it was read from.
    pub fn residual<'a>(&self, bytes: &'a [u8]) -> Result<Residual<'a>, PacketError> {
        self.found.residual(&self.read.head, bytes)
    }

    /// What there is of the residual if its check does not match. Use it only if the bytes are known to be the
    /// undamaged start of a packet.
    pub fn start<'a>(&self, bytes: &'a [u8]) -> Option<ResidualStart<'a>> {
        self.found.start(&self.read.head, bytes)
    }

    /// The truth map; `None`: none was sent, or it is missing in part. If the residual is damaged, it is as reliable as
    /// [`Parsed::start`].
    pub fn truth<'a>(&self, bytes: &'a [u8]) -> Option<&'a [u8]> {
        self.found.truth(&self.read.head, bytes)
    }

    /// Whether the residual is one of a stream.
    pub fn is_in_stream(&self) -> bool {
        self.read.head.is_in_stream()
    }
}

/// What the start of a packet says of the whole packet. Only the checks that need neither prior, camera nor poses are
/// tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Frame number, as the packet states it: modulo 2¹⁶.
    pub frame: u32,
    /// Length of the latent part, bytes.
    pub latent: usize,
    /// Bytes before the residual part. They make a picture.
    pub head: usize,
    /// Bytes after them up to the end of the truth map; 0: there is none, or not all of it is there.
    pub told: usize,
    /// Whether a residual part follows.
    pub has_content: bool,
    /// Whether the frame is one of a stream: others may be predicted from it.
    pub in_stream: bool,
    /// Bytes at the start that the packet's own checks vouch for: the latent part, perhaps with the fixed parts behind
    /// it, or all of the packet. Of a predicted pose, whose check needs other poses, the latent part counts if it can
    /// be read.
    pub valid: usize,
    /// Length of the packet without padding, if all of it is there: its checks match.
    pub whole: Option<usize>,
}

impl Extent {
    /// Reads the first bytes of a packet.
    ///
    /// # Errors
    /// If the latent part is not all there or not valid, as far as that can be told.
    pub fn read(start: &[u8]) -> Result<Extent, PacketError> {
        let layout = Layout::read(start)?;
        if let PoseKind::Absolute(profile) = layout.head.pose {
            layout.absolute(start, profile)?;
        }
        let Layout { head, frame, len: latent, .. } = layout;
        let mut valid = latent;
        let mut at = latent;
        let rest = |at: usize| start.get(at..).unwrap_or(&[]);
        if head.session {
            at += session::LEN;
            if session::is_whole(rest(latent)) {
                valid = at;
            }
        }
        if head.render {
            let is_whole = render::decode(rest(at), &start[..latent]).is_ok();
            let before = at;
            at += render::LEN;
            if is_whole && valid == before {
                valid = at;
            }
        }
        let found = Contents::read(&head, start, latent, at);
        let all_before = valid == at;
        let whole = (all_before && found.checked.is_ok()).then(|| found.end(at));
        let told = found.truth.as_ref().map_or(0, |map| map.end - at);
        let (has_content, in_stream) = (head.has_content(), head.is_in_stream());
        let valid = whole.unwrap_or(valid);
        Ok(Extent { frame, latent, head: at, told, has_content, in_stream, valid, whole })
    }
}
