//! Compute pipelines.

use std::sync::Arc;

use ash::vk;

use super::device::{Inner, c_name};
use super::spirv;
use super::{Device, Error};

/// A compute pipeline whose storage buffers are bindings 0, 1, … of set 0.
#[derive(Clone)]
pub struct Kernel {
    pub(super) shared: Arc<Pipeline>,
}

pub(super) struct Pipeline {
    pub name: &'static str,
    #[cfg(feature = "inspection")]
    pub entry: &'static str,
    pub bindings: u32,
    pub push_bytes: u32,
    pub pipeline: vk::Pipeline,
    pub layout: vk::PipelineLayout,
    pub set_layout: vk::DescriptorSetLayout,
    pub device: Arc<Inner>,
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        if self.device.hung() {
            return;
        }
        let device = &self.device.device;
        // SAFETY: recorded commands hold this Pipeline, so none uses it any more. Destroying a null
        // handle, left by a construction that failed, is allowed.
        unsafe {
            device.destroy_pipeline(self.pipeline, None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

/// What a pipeline is made of.
pub struct Code<'a> {
    /// Entry point.
    pub entry: &'static str,
    /// Its module.
    pub spirv: &'a [u8],
    /// Storage buffers that it uses.
    pub bindings: u32,
    /// Words of push constants that it uses.
    pub push_words: u32,
    /// Specialisation constants, by number. Constants that the module does not have are ignored.
    pub constants: &'a [(u32, u32)],
    /// Invocations of its subgroups, all of which must be full. `None`: any number.
    pub subgroup: Option<u32>,
}

impl Kernel {
    /// Builds the pipeline.
    pub fn new(device: &Device, name: &'static str, code: &Code) -> Result<Kernel, Error> {
        let inner = device.inner.clone();
        let mut pipeline = Pipeline {
            name,
            #[cfg(feature = "inspection")]
            entry: code.entry,
            bindings: code.bindings,
            push_bytes: code.push_words * 4,
            pipeline: vk::Pipeline::null(),
            layout: vk::PipelineLayout::null(),
            set_layout: vk::DescriptorSetLayout::null(),
            device: inner,
        };
        pipeline.make_layout()?;
        pipeline.make_pipeline(code)?;
        Ok(Kernel { shared: Arc::new(pipeline) })
    }
}

impl Pipeline {
    fn make_layout(&mut self) -> Result<(), Error> {
        let device = &self.device.device;
        let bindings: Vec<_> = (0..self.bindings)
            .map(|binding| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: a valid description that lives through the call.
        self.set_layout = unsafe { device.create_descriptor_set_layout(&info, None) }
            .map_err(Error::of("vkCreateDescriptorSetLayout"))?;
        let push = [vk::PushConstantRange::default()
            .stage_flags(vk::ShaderStageFlags::COMPUTE)
            .size(self.push_bytes)];
        let sets = [self.set_layout];
        let mut info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets);
        if self.push_bytes > 0 {
            info = info.push_constant_ranges(&push);
        }
        // SAFETY: as above; the set layout was just made.
        self.layout = unsafe { device.create_pipeline_layout(&info, None) }
            .map_err(Error::of("vkCreatePipelineLayout"))?;
        Ok(())
    }

    fn make_pipeline(&mut self, code: &Code) -> Result<(), Error> {
        let device = &self.device.device;
        let mut words: Vec<u32> = bytemuck::pod_collect_to_vec(code.spirv);
        if self.device.info.rounding_control {
            spirv::round_to_nearest(&mut words);
        }
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the module is one of those committed, which passed spirv-val.
        let module = unsafe { device.create_shader_module(&info, None) }
            .map_err(Error::of("vkCreateShaderModule"))?;
        let entry = c_name(code.entry);
        let values: Vec<u32> = code.constants.iter().map(|(_, value)| *value).collect();
        let place = |(i, (id, _)): (usize, &(u32, u32))| {
            vk::SpecializationMapEntry::default().constant_id(*id).offset(4 * i as u32).size(4)
        };
        let places: Vec<_> = code.constants.iter().enumerate().map(place).collect();
        let constants = vk::SpecializationInfo::default()
            .map_entries(&places)
            .data(bytemuck::cast_slice(&values));
        let mut subgroup = vk::PipelineShaderStageRequiredSubgroupSizeCreateInfo::default()
            .required_subgroup_size(code.subgroup.unwrap_or(0));
        let mut stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(&entry)
            .specialization_info(&constants);
        if code.subgroup.is_some() {
            let full = vk::PipelineShaderStageCreateFlags::REQUIRE_FULL_SUBGROUPS;
            stage = stage.flags(full).push_next(&mut subgroup);
        }
        let mut info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(self.layout);
        if self.device.inspected {
            info = info.flags(vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR);
        }
        // SAFETY: layout and module are valid; the module may go once the pipeline is made. A size of subgroups is
        // asked for if the device was made with the feature: `DeviceInfo::wave`.
        let made = unsafe {
            let made = device.create_compute_pipelines(self.device.pipeline_cache, &[info], None);
            device.destroy_shader_module(module, None);
            made
        };
        let pipelines = made.map_err(|(_, r)| Error::of("vkCreateComputePipelines")(r))?;
        self.pipeline = pipelines[0];
        Ok(())
    }
}
