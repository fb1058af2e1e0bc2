//! The properties that name the prior, the device, the camera and how frames are coded.

/// The class of an element that encodes frames: its properties behind those that all such have.
macro_rules! coding_element {
    (
        wrapper: [$($wrapper:tt)*];
        struct $name:ident {
            $($(#[property($($property:tt)*)])* $field:ident: $type:ty,)*
        }
    ) => {
        #[derive(Default, glib::Properties)]
        #[properties(wrapper_type = $($wrapper)*)]
        pub struct $name {
            #[property(name = "prior", get, set, type = Option<String>, member = prior, mutable_ready,
                blurb = "File of the trained scene: .ply, .nvsg, .nvsb, .spz; the content tells the format")]
            #[property(name = "prior-memory", get, set, type = u32, member = memory, mutable_ready,
                blurb = "Most memory for the splats of a prior in blocks (.nvsb), MiB: only those that cameras see \
                    are loaded; 0: it is loaded whole")]
            #[property(name = "device", get, set, type = Option<String>, member = device, mutable_ready,
                blurb = "The Vulkan device's number, or a part of its name or its driver's name (default: the best \
                    device)")]
            #[property(name = "watchdog", get, set, type = u32, member = watchdog, mutable_ready,
                blurb = "Milliseconds that one submission to the device may take before the device counts as lost; 0: \
                    no bound")]
            prior: Mutex<PriorSettings>,

            #[property(name = "camera", get, set, type = Option<String>, member = camera, mutable_ready,
                blurb = "The pinhole camera: width,height,fx,fy,cx,cy in pixels, or fx,fy,cx,cy for frames as they \
                    come")]
            #[property(name = "width", get, set, type = u32, member = width, mutable_ready, default_value = 320,
                maximum = 4096,
                blurb = "Frames wider than this are reduced to it; 0 keeps every size")]
            #[property(name = "lens", get, set, type = Option<String>, member = lens, mutable_ready,
                blurb = "Distortion by OpenCV's calibration: \
                    brown,width,height,fx,fy,cx,cy,k1,k2,p1,p2[,k3[,k4,k5,k6]] or \
                    fisheye,width,height,fx,fy,cx,cy,k1,k2,k3,k4; camera is then the camera without distortion \
                    (default: one that sees all that the lens does)")]
            #[property(name = "region", get, set, type = Option<String>, member = region, mutable_playing,
                blurb = "What the pilot looks at, x,y,width,height as parts (0 to 1) of the picture's width and \
                    height: it gets more of the bytes, all else fewer")]
            #[property(name = "region-weight", get, set, type = u32, member = region_weight, mutable_playing,
                default_value = 8, minimum = 1, maximum = 255,
                blurb = "How many times more an error in the region counts")]
            #[property(name = "mask", get, set, type = Option<String>, member = mask, mutable_ready,
                blurb = "PNG file of the frames' shape; pixels that are black there do not count, as they show the \
                    vehicle itself")]
            #[property(name = "start", get = Self::start_text, set = Self::set_start, type = Option<String>,
                mutable_playing,
                blurb = "The camera's rough pose at the next frame: qw,qx,qy,qz,tx,ty,tz, world to camera (default: \
                    none, the prior's key frames give it)")]
            #[property(name = "threshold", get, set, type = f64, member = threshold, mutable_ready,
                default_value = 1e-3, minimum = 0.0, maximum = 1.0,
                blurb = "Mean squared error of colours in 0..1 below which a pose is kept where the prior shows too \
                    little to compare pictures")]
            #[property(name = "mode", get, set, type = ModeKind, member = mode, mutable_ready,
                blurb = "Whether difference pictures are predicted from earlier ones", builder(ModeKind::Intra))]
            #[property(name = "tune", get, set, type = TuneKind, member = tune, mutable_ready,
                blurb = "What counts when bits are given to one part of the picture and taken from another",
                builder(TuneKind::Psnr))]
            #[property(name = "structure", get, set, type = StructureKind, member = structure, mutable_ready,
                blurb = "With mode=stream: the reference frame of others", builder(StructureKind::Chain))]
            #[property(name = "key-every", get, set, type = u32, member = key_every, mutable_ready, default_value = 16,
                blurb = "With mode=stream: an intra frame comes after this many frames; 0: no more after the first")]
            #[property(name = "camera-interval", get, set, type = u32, member = camera_interval, mutable_ready,
                default_value = 64,
                blurb = "State prior and camera again after this many frames, for a topside that missed them; 0: \
                    never again")]
            #[property(name = "render-check", get, set, type = u32, member = render_check, mutable_ready,
                blurb = "Send a check of the render (6 bytes) every so many frames; 0: never")]
            #[property(name = "lost-renders", get, set, type = u32, member = lost_renders, mutable_ready,
                default_value = 96,
                blurb = "Most renders that a frame takes beside its first search; the next frames go on; 0: search \
                    from the frame before and from start alone")]
            #[property(name = "frame-time", get, set, type = f64, member = frame_time, mutable_ready, minimum = 0.0,
                maximum = 3_600_000.0,
                blurb = "Most time that a frame takes, milliseconds: one render and one coding must fit; 0: as long \
                    as its search takes")]
            #[property(name = "frames-treated", get, set, type = bool, member = frames_treated, mutable_ready,
                blurb = "Frames come already treated as the prior's preprocessing says")]
            #[property(name = "truth", get, set, type = bool, member = truth, mutable_ready, default_value = true,
                blurb = "Packets tell the topside how far its picture is from what the camera saw, block by block")]
            #[property(name = "post-messages", get, set, type = bool, member = post_messages, mutable_playing,
                blurb = "Post an element message with each frame's figures: nvspenc-frame, nvspvehicle-frame")]
            coding: Mutex<crate::coding::Coding>,

            // The derive macro takes its scope from these signs: all must be from here.
            $($(#[property($($property)*)])* $field: $type,)*
        }

        impl $name {
            fn start_text(&self) -> Option<String> {
                lock(&self.coding).start.clone()
            }

            fn set_start(&self, text: Option<String>) {
                let pose = match text.as_deref().map(property::pose).transpose() {
                    Ok(pose) => Some(pose.map(FrameInfo::from)),
                    Err(error) => {
                        // A wrong pose from a navigation program must not end the dive. At the next start it is an
                        // error.
                        gst::element_imp_warning!(self, gst::LibraryError::Settings, ("{error}"));
                        None
                    }
                };
                let mut coding = lock(&self.coding);
                coding.start = text;
                if let Some(frame_info) = pose {
                    coding.info = frame_info;
                }
            }
        }
    };
}
pub(crate) use coding_element;
