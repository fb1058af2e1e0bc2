//! The topside: packets in, pictures out.

use std::sync::Arc;

use crate::packet::{
    HeldPoses, KnownPose, Latent, PacketError, Parsed, Reference, RenderCheck, Residual, Session,
};
use crate::render::filter::{DisplayFilter, FilterPlan};
use crate::render::{Plan, Renderer, Scene};
use crate::residual::{ResidualDecoder, StreamFrame, Viewpoint};
use crate::truth::{self, TruthDecoder, TruthMap};
use crate::{Camera, Engine, Error, Picture, Pose};

/// A decoded frame.
#[derive(Debug, Default)]
pub struct Decoded {
    /// The picture.
    pub picture: Picture,
    /// Frame number, completed from that of the last packet decoded: see [`Latent::frame_near`].
    pub frame: u32,
    /// The pose it was rendered at, in the world.
    pub pose: Pose,
    /// The vehicle's picture does not confirm the pose.
    pub uncertain: bool,
    /// Within how much the vehicle knows its position; `None`: it does not, so do not navigate by the pose. That the
    /// picture is confirmed (not [`uncertain`](Self::uncertain)) says nothing of it.
    pub known: Option<KnownPose>,
    /// Whether the render is the vehicle's, byte for byte; `None` if the packet does not tell. If it is not, the
    /// picture may be off, since the two devices round differently.
    pub same_render: Option<bool>,
    /// Whether this device and the vehicle's are both portable. If they are, the render is the vehicle's, else it may
    /// differ.
    pub portable: bool,
    /// Rows that the residual reached: all, or none if the picture is the render alone. The more of the residual has
    /// arrived, the finer they are.
    pub rows: u32,
    /// Number of the frame whose residual this one's is predicted from; `None`: it is intra. If that frame is missing,
    /// `damage` says so.
    pub reference: Option<u32>,
    /// Later frames of the stream may be predicted from this one: it came in full. Tell the vehicle, if there is a
    /// return channel: [`Encoder::acknowledge`](crate::Encoder::acknowledge).
    pub kept: bool,
    /// The picture went through the display filter: see [`Decoder::set_filter`].
    pub filtered: bool,
    /// How far the picture is from what the camera saw. It is of the picture before the display filter.
    pub truth: TruthMap,
    /// Why a part of the packet could not be used.
    pub damage: Option<Error>,
}

/// Decodes packets, in any order.
pub struct Decoder {
    engine: Engine,
    scene: Arc<Scene>,
    cameras: Vec<Camera>,
    /// In a box: else the compiler compares cameras before it looks whether there is one, and memory checkers report
    /// that.
    camera_decoder: Option<Box<CameraDecoder>>,
    /// The poses that those of later frames may be predicted from.
    poses: HeldPoses,
    /// Number of the last frame decoded.
    last_frame: Option<u32>,
    /// A packet was about another prior, or its render was another: until one states this prior, none without a session
    /// part is drawn. Tags have 16 bits only.
    is_estranged: bool,
    /// Most pixels of a picture.
    pixel_limit: u32,
    /// `None`: pictures are not filtered.
    filter: Option<FilterPlan>,
}

/// What one camera's packets take.
struct CameraDecoder {
    camera: Camera,
    renderer: Renderer,
    residual: ResidualDecoder,
    truth: TruthDecoder,
    /// Depths of the render's pixels, if the frame has a reference.
    depths: Vec<f32>,
    /// `None`: pictures are not filtered.
    filter: Option<DisplayFilter>,
}

/// A packet that is to be decoded.
struct Arrived<'a> {
    packet: &'a Parsed,
    residual: Result<Residual<'a>, PacketError>,
    bytes: &'a [u8],
    trust: Trust,
    frame: u32,
    /// Both devices are portable.
    portable: bool,
}

impl Arrived<'_> {
    /// What its residual is predicted from, as far as the residual is used.
    fn reference(&self) -> Option<Reference> {
        match &self.residual {
            Ok(Residual::Stream { reference, .. }) => *reference,
            Err(_) if self.trust == Trust::Start => self.packet.start(self.bytes)?.reference,
            _ => None,
        }
    }
}

/// What is known of a packet's bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Trust {
    /// Nothing is known: parts whose check does not match are left out.
    #[default]
    Whole,
    /// They are the undamaged start of a packet, as `nvsprior_link::modem` gives it. If the
    /// residual is cut short, the part that arrived is shown.
    Start,
}

/// Cameras that a decoder remembers.
const CAMERAS: usize = 256;

impl Decoder {
    /// Makes a decoder of packets about an uploaded prior.
    pub fn new(engine: &Engine, scene: &Arc<Scene>) -> Decoder {
        Decoder {
            engine: engine.clone(),
            scene: scene.clone(),
            cameras: Vec::new(),
            camera_decoder: None,
            poses: HeldPoses::with_room(),
            last_frame: None,
            is_estranged: false,
            pixel_limit: u32::MAX,
            filter: None,
        }
    }

    /// Has decoded pictures filtered by a small network from here on, or not. A filtered picture looks more like what
    /// the camera saw, if the network knows the scene. Its weights are the prior's ([`Prior::filter_weights`]), or the
    /// library's. Frames without a residual, or of other coders than the wavelet coder, stay as they are. Later frames
    /// are predicted from pictures before the filter, so each topside may filter or not. At first it is off: it takes
    /// time on the device (`nvsprior-lab bench` measures it).
    ///
    /// [`Prior::filter_weights`]: crate::Prior::filter_weights
    ///
    /// # Errors
    /// If the device fails or has no room; the filter is then off.
    pub fn set_filter(&mut self, on: bool) -> Result<(), Error> {
        self.filter = None;
        if let Some(view) = &mut self.camera_decoder {
            view.filter = None;
        }
        if !on {
            return Ok(());
        }
        let plan = FilterPlan::new(self.engine.vulkan(), &self.scene)?;
        if let Some(view) = &mut self.camera_decoder {
            view.filter = Some(plan.filter(view.camera.width, view.camera.height)?);
        }
        self.filter = Some(plan);
        Ok(())
    }

    /// Refuses pictures of more pixels from here on: no packet can make the decoder take memory for them.
    pub fn set_pixel_limit(&mut self, pixels: u32) {
        self.pixel_limit = pixels;
    }

    fn check_size(&self, width: u32, height: u32) -> Result<(), Error> {
        let limit = self.pixel_limit;
        match u64::from(width) * u64::from(height) > u64::from(limit) {
            true => Err(Error::FrameTooLarge { width, height, limit }),
            false => Ok(()),
        }
    }

    /// The picture size of a packet, if decoding it takes memory: if it is not that of the packet before. `None` also
    /// if its camera is not known.
    pub fn size_to_prepare(&self, packet: &Parsed) -> Option<(u32, u32)> {
        let camera = self.camera_told(packet)?;
        let ready = self.camera_decoder.as_ref().is_some_and(|view| view.camera == camera);
        (!ready).then_some((camera.width, camera.height))
    }

    /// The picture size of a packet, if it is the first of a stream from a camera: decoding it then takes memory for
    /// the reference frames. `None` also as for [`Decoder::size_to_prepare`].
    pub fn stream_to_prepare(&self, packet: &Parsed) -> Option<(u32, u32)> {
        if !packet.is_in_stream() {
            return None;
        }
        let camera = self.camera_told(packet)?;
        let ready = |view: &CameraDecoder| view.camera == camera && !view.depths.is_empty();
        (!self.camera_decoder.as_deref().is_some_and(ready))
            .then_some((camera.width, camera.height))
    }

    /// The picture size of a packet; `None`: its camera is neither told nor known.
    pub fn size_told(&self, packet: &Parsed) -> Option<(u32, u32)> {
        self.camera_told(packet).map(|camera| (camera.width, camera.height))
    }

    /// The camera that a packet tells, or that it names.
    fn camera_told(&self, packet: &Parsed) -> Option<Camera> {
        match packet.session() {
            Ok(Some(session)) => Some(session.camera),
            _ => self.camera_of(packet.latent()).copied(),
        }
    }

    /// Goes on with another engine, after the device of the old one was lost. `scene` is the same
    /// prior, uploaded there. The known cameras carry over.
    pub fn move_to(&mut self, engine: &Engine, scene: &Arc<Scene>) -> Result<(), Error> {
        let (expected, found) = (self.scene.id(), scene.id());
        if expected != found {
            return Err(Error::PriorChanged { expected, found });
        }
        (self.engine, self.scene, self.camera_decoder) = (engine.clone(), scene.clone(), None);
        self.set_filter(self.filter.is_some())
    }

    /// Tells the decoder about a camera that packets only name.
    pub fn add_camera(&mut self, camera: &Camera) -> Result<(), Error> {
        camera.check()?;
        self.check_size(camera.width, camera.height)?;
        if !self.cameras.contains(camera) {
            if self.cameras.len() == CAMERAS {
                self.cameras.remove(0);
            }
            self.cameras.push(*camera);
        }
        Ok(())
    }

    /// Decodes a packet. If only its latent part is valid, the picture is the render alone.
    ///
    /// # Errors
    /// If the latent part is damaged. If it is about another prior ([`PacketError::Prior`]), or a packet before was and
    /// this one does not state its prior ([`Error::Estranged`]). If its prior and camera are not known yet
    /// ([`Error::SessionUnknown`]): the packet that states them is missing.
    pub fn decode(&mut self, bytes: &[u8]) -> Result<Decoded, Error> {
        let mut decoded = Decoded::default();
        self.decode_into(bytes, Trust::Whole, &mut decoded)?;
        Ok(decoded)
    }

    /// As [`Decoder::decode`], but replaces what `decoded` held, and takes the start of a packet too (see [`Trust`]).
    /// Allocates nothing from the second valid packet of a camera on, unless a view of the prior needs more room than
    /// any before.
    pub fn decode_into(
        &mut self,
        bytes: &[u8],
        trust: Trust,
        decoded: &mut Decoded,
    ) -> Result<(), Error> {
        let packet = self.parse(bytes).inspect_err(|error| self.refuse(bytes, error))?;
        self.decode_parsed(&packet, bytes, trust, decoded)
    }

    /// Forgets poses that are not the vehicle's, after [`Decoder::parse`] has refused a packet.
    #[doc(hidden)]
    pub fn refuse(&mut self, bytes: &[u8], error: &PacketError) {
        self.poses.refuse(bytes, error);
    }

    /// Reads what is valid in a packet. Its pose may be predicted from those that are held.
    ///
    /// # Errors
    /// If the latent part is not valid, or what its pose is predicted from is not held.
    pub fn parse(&self, bytes: &[u8]) -> Result<Parsed, PacketError> {
        Parsed::with(bytes, &self.poses)
    }

    /// Holds the pose of a packet that came, and draws nothing: the poses of later packets may be predicted from it.
    /// The start of a packet is enough. Decoding a packet holds its pose, too. Call it as packets come if they are
    /// decoded later, and tell the vehicle: `nvsprior_link::modem::Report::tell_poses`.
    ///
    /// # Errors
    /// As [`parse`](Self::parse), or if the packet is about another prior. If prior and camera are not known here,
    /// nothing is held.
    pub fn hold(&mut self, bytes: &[u8]) -> Result<(), Error> {
        let packet = self.parse(bytes).inspect_err(|error| self.refuse(bytes, error))?;
        let frame = packet.latent().frame_near(self.poses.last().or(self.last_frame));
        self.learn_session(&packet, frame)?;
        self.hold_pose(frame, packet.latent())
    }

    fn hold_pose(&mut self, frame: u32, latent: &Latent) -> Result<(), Error> {
        let Some(camera) = self.camera_of(latent).copied() else { return Ok(()) };
        let session = Session { prior: self.scene.id(), camera };
        Ok(self.poses.hold(frame, latent, &session)?)
    }

    /// Takes what a packet states of prior and camera. Returns why it could not be used, if it is damaged.
    ///
    /// # Errors
    /// If the packet is about another prior, or one before was and this one does not state its prior.
    fn learn_session(&mut self, packet: &Parsed, frame: u32) -> Result<Option<Error>, Error> {
        let damage = match packet.session() {
            Ok(Some(Session { prior, camera })) => {
                let held = self.scene.id();
                if *prior != held {
                    self.estrange();
                    return Err(PacketError::Prior { packet: *prior, held }.into());
                }
                self.check_size(camera.width, camera.height)?;
                self.is_estranged = false;
                return Ok(self.add_camera(camera).err());
            }
            Ok(None) => None,
            Err(error) => Some(error.clone().into()),
        };
        if self.is_estranged { Err(Error::Estranged { frame }) } else { Ok(damage) }
    }

    /// What comes may be about another prior.
    fn estrange(&mut self) {
        self.is_estranged = true;
        self.poses.clear();
    }

    /// Whether the pose of a frame is held, of the last 128 that came. The number may be modulo 2¹⁶.
    pub fn holds_pose(&self, frame: u32) -> bool {
        self.poses.holds(frame)
    }

    /// As [`Decoder::decode_into`], for bytes that were read before.
    pub fn decode_parsed(
        &mut self,
        packet: &Parsed,
        bytes: &[u8],
        trust: Trust,
        decoded: &mut Decoded,
    ) -> Result<(), Error> {
        let latent = *packet.latent();
        let frame = latent.frame_near(self.last_frame);
        let session_damage = self.learn_session(packet, frame)?;
        let pose = self.stated_pose(&latent);
        let known = self.known_pose(&latent);
        let here = self.engine.device().portable;
        let camera = self.named_camera(&latent, frame)?;
        let view = self.camera_decoder(&camera)?;
        let Camera { width, height, .. } = view.camera;
        decoded.picture.resize(width, height);
        let portable = latent.portable && here;
        let residual = packet.residual(bytes);
        let arrived = Arrived { packet, residual, bytes, trust, frame, portable };
        let viewpoint = view.draw(&latent, &arrived, &mut decoded.picture)?;
        let behind = arrived.reference().map(|reference| u32::from(reference.distance));
        decoded.reference = behind.map(|by| frame.wrapping_sub(by));
        (decoded.frame, decoded.pose) = (frame, pose);
        decoded.uncertain = latent.uncertain;
        decoded.known = known;
        decoded.portable = portable;
        let told = packet.render().as_ref().ok().copied().flatten();
        decoded.same_render = told.map(|check| check == RenderCheck::of(&decoded.picture));
        let rows = view.add_residual(&arrived, &viewpoint, &mut decoded.picture);
        let whole = matches!(arrived.residual, Ok(Residual::Stream { .. })) && rows.is_ok();
        decoded.kept = whole && portable;
        (decoded.damage, decoded.rows) = match rows {
            Ok((rows, damage)) => (damage.or(session_damage), rows),
            Err(error) => (Some(error), 0),
        };
        decoded.truth.reset(width, height);
        // Of another picture than the vehicle's, nothing is known.
        if decoded.same_render != Some(false) {
            let Decoded { rows, picture, truth, .. } = decoded;
            view.read_truth(&arrived, *rows > 0, picture, truth);
        }
        decoded.filtered = decoded.rows > 0 && view.filter(&mut decoded.picture)?;
        self.last_frame = Some(frame);
        if portable && decoded.same_render == Some(false) {
            self.estrange();
            return Ok(());
        }
        self.hold_pose(frame, &latent)
    }

    /// Draws the prior at a pose as the camera of the packet decoded last sees it; `false` if there was none yet. This
    /// is for frames whose packets are missing: see [`Pose::between`].
    pub fn draw(&mut self, pose: &Pose, picture: &mut Picture) -> Result<bool, Error> {
        let Some(view) = &mut self.camera_decoder else { return Ok(false) };
        picture.resize(view.camera.width, view.camera.height);
        view.renderer.picture(&pose.relative_to(self.scene.origin()), picture)?;
        Ok(true)
    }

    /// The camera of the packet decoded last, for which [`Decoder::draw`] draws.
    pub fn camera(&self) -> Option<&Camera> {
        self.camera_decoder.as_ref().map(|view| &view.camera)
    }

    /// The pose that a packet states, and whether the vehicle is certain of it. The start of a packet is enough.
    ///
    /// # Errors
    /// If its latent part is damaged.
    pub fn pose_of(&self, packet: &[u8]) -> Result<(Pose, bool), Error> {
        let latent = self.poses.latent(packet)?;
        Ok((self.stated_pose(&latent), !latent.uncertain))
    }

    /// In the world.
    fn stated_pose(&self, latent: &Latent) -> Pose {
        let pose = latent.pose.dequantise(&self.scene.coordinate_frame());
        pose.absolute_from(self.scene.origin())
    }

    /// Within how much the vehicle knows the pose that a packet states.
    pub fn known_pose(&self, latent: &Latent) -> Option<KnownPose> {
        latent.known.map(|bound| bound.of_unit(self.scene.coordinate_frame().unit()))
    }

    /// The newest known camera that a packet may be about.
    pub fn camera_of(&self, latent: &Latent) -> Option<&Camera> {
        let prior = self.scene.id();
        let named = |camera: &&Camera| Session { prior, camera: **camera }.tag() == Ok(latent.tag);
        self.cameras.iter().rev().find(named)
    }

    /// The camera that a packet names.
    fn named_camera(&self, latent: &Latent, frame: u32) -> Result<Camera, Error> {
        let unknown = || Error::SessionUnknown {
            frame,
            tag: latent.tag,
            prior: self.scene.id(),
            cameras: self.cameras.len(),
        };
        self.camera_of(latent).copied().ok_or_else(unknown)
    }

    /// What renders for a camera.
    fn camera_decoder(&mut self, camera: &Camera) -> Result<&mut CameraDecoder, Error> {
        if self.camera_decoder.as_ref().is_some_and(|view| view.camera != *camera) {
            // The new one takes its room on the device.
            self.camera_decoder = None;
        }
        match &mut self.camera_decoder {
            Some(view) => Ok(view),
            none => {
                let filter =
                    self.filter.as_ref().map(|plan| plan.filter(camera.width, camera.height));
                let plan = Plan { depths: true, ..Plan::picture() };
                let (width, height) = (camera.width, camera.height);
                Ok(none.insert(Box::new(CameraDecoder {
                    camera: *camera,
                    renderer: self.engine.renderer(&self.scene, camera, plan)?,
                    depths: Vec::new(),
                    residual: ResidualDecoder::new(width, height, self.scene.coder_tables()),
                    truth: TruthDecoder::new(width, height),
                    filter: filter.transpose()?,
                })))
            }
        }
    }
}

impl CameraDecoder {
    /// Draws the render; with depths, if it takes them to add the residual. Returns where it is seen from.
    fn draw(
        &mut self,
        latent: &Latent,
        arrived: &Arrived,
        picture: &mut Picture,
    ) -> Result<Viewpoint, Error> {
        let code = latent.pose.words();
        let viewpoint = Viewpoint { camera: self.camera, placement: self.renderer.placed(&code) };
        let is_held = |reference| self.residual.holds(reference, arrived.frame, &viewpoint);
        let deep = arrived.portable && arrived.reference().is_some_and(is_held);
        match deep {
            true => self.renderer.draw_coded_deep(&code)?,
            false => self.renderer.draw_coded(&code)?,
        }
        picture.data.copy_from_slice(self.renderer.rendered());
        if deep {
            self.depths.clear();
            self.depths.extend(self.renderer.depths());
        } else if matches!(arrived.residual, Ok(Residual::Stream { .. })) {
            // Room is made with the first frame of a stream.
            self.depths.resize(self.camera.pixels(), 0.0);
        }
        Ok(viewpoint)
    }

    /// Filters a picture to which a residual was added; `false`: it stays as it is.
    fn filter(&mut self, picture: &mut Picture) -> Result<bool, Error> {
        let (Some(filter), Some(step)) = (&mut self.filter, self.residual.step()) else {
            return Ok(false);
        };
        filter.apply(step.index(), self.renderer.rendered(), picture)?;
        Ok(true)
    }

    /// Reads what the packet tells of its picture. `added`: some of the residual was added.
    fn read_truth(
        &mut self,
        arrived: &Arrived,
        added: bool,
        picture: &Picture,
        map: &mut TruthMap,
    ) {
        let Arrived { packet, ref residual, bytes, trust, frame, .. } = *arrived;
        let Some(bytes) = packet.truth(bytes) else { return };
        let of_map = match residual {
            Ok(Residual::None | Residual::Omitted) => truth::Arrived::All,
            Ok(_) if added => truth::Arrived::All,
            Err(_) if added && trust == Trust::Start => {
                truth::Arrived::Start { render: self.renderer.rendered(), picture: &picture.data }
            }
            _ => return,
        };
        self.truth.decode(frame, bytes, of_map, map);
    }

    /// Turns the render into the picture. Returns the rows that a residual reached, and what was damaged.
    fn add_residual(
        &mut self,
        arrived: &Arrived,
        viewpoint: &Viewpoint,
        picture: &mut Picture,
    ) -> Result<(u32, Option<Error>), Error> {
        let Arrived { packet, ref residual, bytes, trust, frame, portable } = *arrived;
        let stream = StreamFrame { frame, viewpoint, depths: &self.depths };
        let error = match residual {
            Ok(Residual::None | Residual::Omitted) => return Ok((0, None)),
            Ok(residual) => {
                self.residual.add_in_stream(residual, &stream, portable, picture)?;
                return Ok((picture.height, None));
            }
            Err(error) => error.clone().into(),
        };
        match packet.start(bytes).filter(|_| trust == Trust::Start) {
            Some(start) if start.reference.is_some() => {
                self.residual.add_start_in_stream(&start, &stream, portable, picture)?;
            }
            Some(start) => self.residual.add_start(&start, portable, picture)?,
            None => return Err(error),
        }
        Ok((picture.height, Some(error)))
    }
}
