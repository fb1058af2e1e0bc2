//! What a driver's compiler makes of pipelines, by `VK_KHR_pipeline_executable_properties`. Nothing is submitted, so a
//! device without hardware is enough.

use std::ffi::CStr;

use ash::{khr, vk};

use super::instance::Opened;
use super::{Device, DeviceOptions, Error, Kernel};

/// A pipeline as the driver's compiler made it.
#[derive(Clone, Debug)]
pub struct Compiled {
    /// Its entry point, as the module names it.
    pub entry: &'static str,
    /// Invocations of a subgroup that it was compiled for.
    pub subgroup: u32,
    /// What the compiler tells, by the driver's names.
    pub statistics: Vec<(String, f64)>,
}

impl Device {
    /// Opens the device of this name to see what its compiler makes of pipelines: [`Kernel::compiled`]. `subgroup`: the
    /// size that its driver was told to compile for. (RADV states 64 whatever it compiles for.) Nothing may be
    /// submitted to it.
    pub fn open_for_inspection(name: &str, subgroup: u32) -> Result<Device, Error> {
        let mut opened = Opened::own(false, Some(name), true)?;
        opened.info.subgroup = subgroup;
        opened.info.wave = opened.info.wave.map(|_| subgroup);
        Device::with(opened, &DeviceOptions::default())
    }
}

impl Kernel {
    /// What the compiler made of it. Fails on devices that were not opened for inspection.
    pub fn compiled(&self) -> Result<Compiled, Error> {
        let pipeline = &self.shared;
        let inner = &pipeline.device;
        if !inner.inspected {
            let (call, result) =
                ("vkGetPipelineExecutablePropertiesKHR", vk::Result::ERROR_EXTENSION_NOT_PRESENT);
            return Err(Error::Call { call, result });
        }
        let instance = &inner.instance.instance;
        let functions = khr::pipeline_executable_properties::Device::new(instance, &inner.device);
        let info = vk::PipelineInfoKHR::default().pipeline(pipeline.pipeline);
        // SAFETY: a pipeline of this device, made to be captured.
        let properties = unsafe { functions.get_pipeline_executable_properties(&info) }
            .map_err(Error::of("vkGetPipelineExecutablePropertiesKHR"))?;
        // A compute pipeline is one executable.
        let info = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline.pipeline);
        // SAFETY: as above.
        let statistics = unsafe { functions.get_pipeline_executable_statistics(&info) }
            .map_err(Error::of("vkGetPipelineExecutableStatisticsKHR"))?;
        Ok(Compiled {
            entry: pipeline.entry,
            subgroup: properties.first().map_or(0, |executable| executable.subgroup_size),
            statistics: statistics.iter().map(named_number).collect(),
        })
    }
}

fn text(name: Result<&CStr, std::ffi::FromBytesUntilNulError>) -> String {
    name.unwrap_or(c"?").to_string_lossy().into_owned()
}

fn named_number(statistic: &vk::PipelineExecutableStatisticKHR) -> (String, f64) {
    use vk::PipelineExecutableStatisticFormatKHR as Format;
    let value = &statistic.value;
    // SAFETY: the format says which field the driver has written.
    let number = unsafe {
        match statistic.format {
            Format::BOOL32 => f64::from(value.b32),
            Format::INT64 => value.i64 as f64,
            Format::UINT64 => value.u64 as f64,
            _ => value.f64,
        }
    };
    (text(statistic.name_as_c_str()), number)
}
