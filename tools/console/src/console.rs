//! `nvsprior console`: the topside as one program, and the pilot's screen.

mod canvas;
mod chase_view;
mod clock;
mod disk;
mod event;
mod framed;
mod input;
mod keeper;
mod link_log;
mod missing;
mod overlay;
mod pictures;
mod plan_view;
mod projection;
mod recording;
mod resume;
mod scene_views;
mod serial;
mod server;
mod state;
mod token;
mod told_before;
mod topside;
mod track;
mod video;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::mpsc::sync_channel;

use nvsprior::Engine;
use nvsprior::vulkan::DeviceKind;
use nvsprior_inputs::args::{DeviceArgs, PriorArgs};
use nvsprior_inputs::keys::KeyArgs;
use nvsprior_link::TopsideLink;

use crate::endpoint;
use crate::journal::LogArgs;
use crate::state_file::{self, Side, StateFile};
use event::EVENTS;
use input::SourceArgs;
use keeper::Keeper;
use pictures::Pictures;
use resume::Resume;
use server::Server;
use topside::{Topside, TopsideOptions};
use video::VideoTarget;

/// Show the pilot what comes: the topside's half of a working link
///
/// Takes modem frames, puts packets together, decodes them, reports to the vehicle, and serves a page: the picture with
/// its age, what may be believed of it, the vehicle on a map of the prior, the view from behind it, and the link. It
/// runs until it is stopped. The keys are on the page.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    #[command(flatten)]
    source: SourceArgs,
    /// Where the page is. At any other than a loopback address it takes the token that is printed with it
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8080", value_parser = endpoint::remote)]
    listen: SocketAddr,
    /// Folder for snapshots and recordings; made with the first one
    #[arg(long, value_name = "DIR", default_value = "console-out")]
    keep: PathBuf,
    /// Also send the picture with its overlay as video, RTP with H.264. QGroundControl takes it on port 5600, Cockpit
    /// through mavlink-camera-manager alone. Takes GStreamer
    #[arg(long, value_name = "HOST:PORT", value_parser = endpoint::remote)]
    rtp: Option<SocketAddr>,
    /// Filter the picture by a small network that knows the scene (the prior's weights, which `nvsprior prior filter`
    /// trains), or by the library's: always, never, or if the device is no CPU
    #[arg(long, value_name = "WHEN", default_value = "auto")]
    filter: FilterUse,
    /// Most bytes of a modem frame, as the vehicle has it
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u16).range(16..))]
    mtu: u16,
    #[command(flatten)]
    key: KeyArgs,
    #[command(flatten)]
    log: LogArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Whether pictures go through the display filter.
#[derive(Clone, Copy, clap::ValueEnum)]
enum FilterUse {
    Auto,
    On,
    Off,
}

impl FilterUse {
    fn on(self, engine: &Engine) -> bool {
        match self {
            FilterUse::Auto => engine.device().kind != DeviceKind::Cpu,
            FilterUse::On => true,
            FilterUse::Off => false,
        }
    }
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let (events, came) = sync_channel(EVENTS);
    // Ports and files are looked at before the device is opened: that takes seconds.
    let source = args.source.open(args.mtu.into())?;
    let mut link = Pictures::options(args.mtu.into());
    link.keys = args.key.open()?;
    let mut state = None;
    // Of a recording all passes once more.
    if !source.is_recording()
        && let Some(key) = &args.key.key
    {
        let (stored, file) = StateFile::open(key, Side::Topside)?;
        link.state = stored;
        state_file::check(TopsideLink::new(&link), &file)?;
        state = Some(file);
    }
    let journal = args.log.open("console")?;
    let server = Server::bind(args.listen)?;
    let video = args.rtp.map(VideoTarget::new).transpose()?;
    let prior = args.prior.open()?;
    if prior.extras().doubt.is_none() {
        let prior = args.prior.prior.display();
        tell!("{prior}: without doubt: all that was not seen is doubtful (`nvsprior prior doubt`)");
    }
    let engine = args.device.open()?;
    let prior_file = args.prior.prior.file_name().unwrap_or_default().display().to_string();
    let options = TopsideOptions {
        prior_file,
        link,
        source: source.name(),
        clock: source.clock(),
        return_path: source.return_path()?,
        keeper: Keeper::new(args.keep.clone()),
        // What is played is no dive that goes on.
        resume: (!source.is_recording()).then(|| Resume::new(&args.keep)),
        journal,
        video: video.map(|target| target.start(source.clock())).transpose()?,
        filter: args.filter.on(&engine),
        key: args.key.key.as_ref().map(|_| args.key.to_string()),
        state,
    };
    let (topside, published) = Topside::new(&engine, &prior, options)?;
    source.start(events.clone())?;
    let page = server.start(topside.plan_picture(), published, events)?;
    say!("console: {} on {}", topside.source(), page);
    topside.run(&came)
}
