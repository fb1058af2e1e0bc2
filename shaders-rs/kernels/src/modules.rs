//! The built SPIR-V: one module per entry point, as a constant with the entry point's name.

/// A built entry point.
#[derive(Clone, Copy, Debug)]
pub struct Module {
    /// Its name in the module.
    pub entry: &'static str,
    /// The module.
    pub spirv: &'static [u8],
}

/// Makes one constant per entry point: those of each file of the stages. `make shaders` writes the list.
macro_rules! modules {
    ($($file:ident: $($name:ident)+;)+) => {
        $($(
            #[doc = concat!("Stage `", stringify!($name), "`.")]
            #[allow(non_upper_case_globals)] // Named as the stage is.
            pub const $name: Module = Module {
                entry: concat!(stringify!($file), "::", stringify!($name)),
                spirv: include_bytes!(concat!("../spv/", stringify!($name), ".spv")),
            };
        )+)+

        /// All of them.
        pub const ALL: &[Module] = &[$($($name),+),+];
    };
}

include!("../spv/modules.rs");
