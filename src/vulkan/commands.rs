//! Command buffers: recorded once, run many times.

use std::sync::{Arc, Mutex, MutexGuard};

use ash::vk;

use super::buffer::Shared;
use super::device::Inner;
use super::kernel::Pipeline;
use super::{Buffer, Device, Error, Kernel};

/// Time that the device spent in one stage.
#[derive(Clone, Debug, PartialEq)]
pub struct StageTime {
    /// The stage's name.
    pub name: &'static str,
    /// Milliseconds.
    pub milliseconds: f64,
}

/// Which parts of a recording the device times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timing {
    /// Nothing.
    None,
    /// The ends of what [`Recorder::mark`] names.
    Marks,
    /// Every stage, and the marks.
    Stages,
}

/// How many commands of each kind a recording has. Each costs time, whatever it does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CommandCounts {
    /// Dispatches, empty indirect ones included.
    pub dispatches: u32,
    /// Fills of a buffer.
    pub fills: u32,
    /// Copies from buffer to buffer.
    pub copies: u32,
    /// Barriers.
    pub barriers: u32,
}

/// A part of a buffer that is copied into another, in words of four bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Where it begins.
    pub from: u64,
    /// Where it goes.
    pub to: u64,
    /// How long it is.
    pub words: u64,
}

impl CommandCounts {
    /// Those of this recording that an earlier state of it had not.
    pub fn since(self, earlier: CommandCounts) -> CommandCounts {
        CommandCounts {
            dispatches: self.dispatches - earlier.dispatches,
            fills: self.fills - earlier.fills,
            copies: self.copies - earlier.copies,
            barriers: self.barriers - earlier.barriers,
        }
    }
}

/// Descriptor sets that one pool of a recording holds. A longer recording takes more pools.
const SETS_PER_POOL: u32 = 64;
/// Most storage buffers of one kernel.
const BUFFERS_PER_SET: u32 = 8;

/// Records dispatches; each waits for what was recorded before it.
pub struct Recorder {
    commands: Commands,
    sets_left: u32,
    timing: Timing,
}

/// A recorded command buffer with all that it uses.
pub struct Commands {
    device: Arc<Inner>,
    pool: vk::CommandPool,
    buffer: vk::CommandBuffer,
    fence: vk::Fence,
    descriptor_pools: Vec<vk::DescriptorPool>,
    queries: vk::QueryPool,
    /// For each query after the first: what it ends, and whether that is a stage (else a mark).
    timed: Vec<(&'static str, bool)>,
    /// What the queries held after the last run.
    ticks: Mutex<Vec<u64>>,
    counts: CommandCounts,
    /// What was recorded up to each mark, with the mark's name.
    marked: Vec<(&'static str, CommandCounts)>,
    buffers: Vec<Arc<Shared>>,
    pipelines: Vec<Arc<Pipeline>>,
}

/// Most stages and marks that a recording times.
const QUERIES: u32 = 1024;

impl Drop for Commands {
    fn drop(&mut self) {
        if self.device.hung() {
            return;
        }
        let device = &self.device.device;
        // SAFETY: `run` waits for the end, so nothing is in flight; null handles are allowed.
        unsafe {
            device.destroy_fence(self.fence, None);
            device.destroy_query_pool(self.queries, None);
            for pool in &self.descriptor_pools {
                device.destroy_descriptor_pool(*pool, None);
            }
            device.destroy_command_pool(self.pool, None);
        }
    }
}

impl Recorder {
    /// Begins a recording.
    pub fn new(device: &Device, timing: Timing) -> Result<Recorder, Error> {
        let timing = if device.inner.timestamps { timing } else { Timing::None };
        let mut commands = Commands {
            device: device.inner.clone(),
            pool: vk::CommandPool::null(),
            buffer: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
            descriptor_pools: Vec::new(),
            queries: vk::QueryPool::null(),
            timed: Vec::new(),
            ticks: Mutex::default(),
            counts: CommandCounts::default(),
            marked: Vec::new(),
            buffers: Vec::new(),
            pipelines: Vec::new(),
        };
        commands.make(timing != Timing::None)?;
        Ok(Recorder { commands, sets_left: 0, timing })
    }

    /// Records a dispatch of `groups` workgroups. `buffers` go to bindings 0, 1, …
    ///
    /// # Panics
    /// If the numbers of buffers or push constants are not the kernel's.
    pub fn dispatch(
        &mut self,
        kernel: &Kernel,
        buffers: &[&Buffer],
        push: &[u32],
        groups: [u32; 3],
    ) -> Result<(), Error> {
        self.stage(kernel, buffers, push, |device, commands| {
            // SAFETY: recording is open and the pipeline with its set is bound.
            unsafe { device.cmd_dispatch(commands, groups[0], groups[1], groups[2]) }
        })
    }

    /// As [`dispatch`](Self::dispatch), but the device reads the numbers of workgroups from three
    /// words of `groups` at byte `offset` when it gets there.
    pub fn dispatch_indirect(
        &mut self,
        kernel: &Kernel,
        buffers: &[&Buffer],
        push: &[u32],
        groups: &Buffer,
        offset: u64,
    ) -> Result<(), Error> {
        assert!(
            offset.is_multiple_of(4) && offset + 12 <= groups.bytes(),
            "indirect words out of bounds"
        );
        let raw = groups.shared.raw;
        self.commands.buffers.push(groups.shared.clone());
        self.stage(kernel, buffers, push, |device, commands| {
            // SAFETY: as above; the words lie inside the buffer, which this recording keeps.
            unsafe { device.cmd_dispatch_indirect(commands, raw, offset) }
        })
    }

    fn stage(
        &mut self,
        kernel: &Kernel,
        buffers: &[&Buffer],
        push: &[u32],
        dispatch: impl FnOnce(&ash::Device, vk::CommandBuffer),
    ) -> Result<(), Error> {
        let pipeline = kernel.shared.clone();
        assert_eq!(buffers.len(), pipeline.bindings as usize, "buffers of {}", pipeline.name);
        assert_eq!(push.len() * 4, pipeline.push_bytes as usize, "constants of {}", pipeline.name);
        let set = self.bind(&pipeline, buffers)?;
        let inner = self.commands.device.clone();
        let (device, commands) = (&inner.device, self.commands.buffer);
        // SAFETY: recording is open; pipeline, layout and set belong together.
        unsafe {
            let point = vk::PipelineBindPoint::COMPUTE;
            device.cmd_bind_pipeline(commands, point, pipeline.pipeline);
            device.cmd_bind_descriptor_sets(commands, point, pipeline.layout, 0, &[set], &[]);
            if !push.is_empty() {
                let bytes = bytemuck::cast_slice(push);
                let compute = vk::ShaderStageFlags::COMPUTE;
                device.cmd_push_constants(commands, pipeline.layout, compute, 0, bytes);
            }
        }
        dispatch(device, commands);
        self.commands.counts.dispatches += 1;
        self.barrier(pipeline.name);
        self.commands.pipelines.push(pipeline);
        Ok(())
    }

    /// Fills a buffer with a word.
    pub fn fill(&mut self, buffer: &Buffer, word: u32) {
        let raw = buffer.shared.raw;
        // SAFETY: recording is open; the recording keeps the buffer.
        unsafe {
            let device = &self.commands.device.device;
            device.cmd_fill_buffer(self.commands.buffer, raw, 0, vk::WHOLE_SIZE, word);
        }
        self.commands.buffers.push(buffer.shared.clone());
        self.commands.counts.fills += 1;
        self.barrier("fill");
    }

    /// Sets the first words of a buffer to zero, beside what is recorded next: the barrier after that is for both.
    ///
    /// # Panics
    /// If the buffer has fewer.
    pub fn clear_beside(&mut self, buffer: &Buffer, words: u32) {
        let bytes = u64::from(words) * 4;
        assert!(bytes <= buffer.bytes(), "words out of bounds");
        let raw = buffer.shared.raw;
        // SAFETY: recording is open; the words lie inside the buffer, which the recording keeps.
        unsafe {
            let device = &self.commands.device.device;
            device.cmd_fill_buffer(self.commands.buffer, raw, 0, bytes, 0);
        }
        self.commands.buffers.push(buffer.shared.clone());
        self.commands.counts.fills += 1;
    }

    /// Copies as much of `from` as `to` holds.
    pub fn copy(&mut self, from: &Buffer, to: &Buffer) {
        self.copy_beside(from, to);
        self.barrier("copy");
    }

    /// As [`copy`](Self::copy), beside what is recorded next: the barrier after that is for both.
    pub fn copy_beside(&mut self, from: &Buffer, to: &Buffer) {
        let region = [vk::BufferCopy::default().size(from.bytes().min(to.bytes()))];
        // SAFETY: as above; the region lies inside both.
        unsafe {
            self.commands.device.device.cmd_copy_buffer(
                self.commands.buffer,
                from.shared.raw,
                to.shared.raw,
                &region,
            );
        }
        self.commands.buffers.extend([from.shared.clone(), to.shared.clone()]);
        self.commands.counts.copies += 1;
    }

    /// Copies parts of a buffer, which do not overlap in `to`, beside what is recorded next: the barrier after that is
    /// for both.
    ///
    /// # Panics
    /// If a part does not lie inside both.
    pub fn copy_parts(&mut self, from: &Buffer, to: &Buffer, parts: &[Part]) {
        let region = |part: &Part| {
            let [from_byte, to_byte, bytes] = [part.from, part.to, part.words].map(|w| 4 * w);
            let fits = from_byte + bytes <= from.bytes() && to_byte + bytes <= to.bytes();
            assert!(fits && bytes > 0, "a part out of bounds");
            vk::BufferCopy::default().src_offset(from_byte).dst_offset(to_byte).size(bytes)
        };
        let regions: Vec<_> = parts.iter().map(region).collect();
        // SAFETY: recording is open; the regions lie inside both buffers, which the recording keeps.
        unsafe {
            self.commands.device.device.cmd_copy_buffer(
                self.commands.buffer,
                from.shared.raw,
                to.shared.raw,
                &regions,
            );
        }
        self.commands.buffers.extend([from.shared.clone(), to.shared.clone()]);
        self.commands.counts.copies += 1;
    }

    /// Ends the recording.
    pub fn finish(self) -> Result<Commands, Error> {
        // SAFETY: recording is open.
        unsafe { self.commands.device.device.end_command_buffer(self.commands.buffer) }
            .map_err(Error::of("vkEndCommandBuffer"))?;
        let mut commands = self.commands;
        commands.ticks = Mutex::new(Vec::with_capacity(commands.timed.len() + 1));
        Ok(commands)
    }

    /// Makes all that was written visible to what follows, host included, and notes the time.
    pub fn barrier(&mut self, name: &'static str) {
        use vk::{AccessFlags as Access, PipelineStageFlags as Stage};
        let device = &self.commands.device.device;
        let commands = self.commands.buffer;
        let memory = [vk::MemoryBarrier::default()
            .src_access_mask(Access::SHADER_WRITE | Access::TRANSFER_WRITE)
            .dst_access_mask(
                Access::SHADER_READ
                    | Access::SHADER_WRITE
                    | Access::TRANSFER_READ
                    | Access::TRANSFER_WRITE
                    | Access::INDIRECT_COMMAND_READ
                    | Access::HOST_READ,
            )];
        let from = Stage::COMPUTE_SHADER | Stage::TRANSFER;
        let to = from | Stage::DRAW_INDIRECT | Stage::HOST;
        let flags = vk::DependencyFlags::empty();
        // SAFETY: recording is open.
        unsafe { device.cmd_pipeline_barrier(commands, from, to, flags, &memory, &[], &[]) };
        self.commands.counts.barriers += 1;
        if self.timing == Timing::Stages {
            self.stamp(name, true);
        }
    }

    /// Names the end of what was recorded so far, for [`Commands::marks`] and [`Commands::counts_at`].
    pub fn mark(&mut self, name: &'static str) {
        self.commands.marked.push((name, self.commands.counts));
        if self.timing != Timing::None {
            self.stamp(name, false);
        }
    }

    fn stamp(&mut self, name: &'static str, stage: bool) {
        let query = self.commands.timed.len() as u32 + 1;
        if query < QUERIES {
            let (device, all) =
                (&self.commands.device.device, vk::PipelineStageFlags::BOTTOM_OF_PIPE);
            let (commands, queries) = (self.commands.buffer, self.commands.queries);
            // SAFETY: recording is open; the pool has QUERIES entries, reset at its start.
            unsafe { device.cmd_write_timestamp(commands, all, queries, query) };
            self.commands.timed.push((name, stage));
        }
    }

    /// A descriptor set with `buffers` at bindings 0, 1, …
    fn bind(&mut self, kernel: &Pipeline, buffers: &[&Buffer]) -> Result<vk::DescriptorSet, Error> {
        if self.sets_left == 0 {
            self.commands.add_descriptor_pool()?;
            self.sets_left = SETS_PER_POOL;
        }
        self.sets_left -= 1;
        let device = &self.commands.device.device;
        let layouts = [kernel.set_layout];
        let pool = self.commands.descriptor_pools.last().copied().unwrap_or_default();
        let info =
            vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: the pool has room for the set and for BUFFERS_PER_SET buffers in each.
        let set = unsafe { device.allocate_descriptor_sets(&info) }
            .map_err(Error::of("vkAllocateDescriptorSets"))?[0];
        let infos: Vec<_> = buffers
            .iter()
            .map(|b| {
                [vk::DescriptorBufferInfo::default().buffer(b.shared.raw).range(vk::WHOLE_SIZE)]
            })
            .collect();
        let writes: Vec<_> = (0..)
            .zip(&infos)
            .map(|(binding, info)| {
                vk::WriteDescriptorSet::default()
                    .dst_set(set)
                    .dst_binding(binding)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .buffer_info(info)
            })
            .collect();
        // SAFETY: set, buffers and infos are alive; the recording keeps the buffers.
        unsafe { device.update_descriptor_sets(&writes, &[]) };
        self.commands.buffers.extend(buffers.iter().map(|b| b.shared.clone()));
        Ok(set)
    }
}

impl Commands {
    fn make(&mut self, timed: bool) -> Result<(), Error> {
        let device = &self.device.device;
        let info =
            vk::CommandPoolCreateInfo::default().queue_family_index(self.device.queue_family);
        // SAFETY: valid descriptions throughout; handles go into `self`, which destroys them.
        unsafe {
            self.pool = device
                .create_command_pool(&info, None)
                .map_err(Error::of("vkCreateCommandPool"))?;
            let info = vk::CommandBufferAllocateInfo::default()
                .command_pool(self.pool)
                .level(vk::CommandBufferLevel::PRIMARY)
                .command_buffer_count(1);
            self.buffer = device
                .allocate_command_buffers(&info)
                .map_err(Error::of("vkAllocateCommandBuffers"))?[0];
            self.fence = device
                .create_fence(&vk::FenceCreateInfo::default(), None)
                .map_err(Error::of("vkCreateFence"))?;
            device
                .begin_command_buffer(self.buffer, &vk::CommandBufferBeginInfo::default())
                .map_err(Error::of("vkBeginCommandBuffer"))?;
            if timed {
                let info = vk::QueryPoolCreateInfo::default()
                    .query_type(vk::QueryType::TIMESTAMP)
                    .query_count(QUERIES);
                self.queries = device
                    .create_query_pool(&info, None)
                    .map_err(Error::of("vkCreateQueryPool"))?;
                device.cmd_reset_query_pool(self.buffer, self.queries, 0, QUERIES);
                let top = vk::PipelineStageFlags::TOP_OF_PIPE;
                device.cmd_write_timestamp(self.buffer, top, self.queries, 0);
            }
        }
        Ok(())
    }

    fn add_descriptor_pool(&mut self) -> Result<(), Error> {
        let sizes = [vk::DescriptorPoolSize::default()
            .ty(vk::DescriptorType::STORAGE_BUFFER)
            .descriptor_count(SETS_PER_POOL * BUFFERS_PER_SET)];
        let info =
            vk::DescriptorPoolCreateInfo::default().max_sets(SETS_PER_POOL).pool_sizes(&sizes);
        // SAFETY: a valid description.
        let pool = unsafe { self.device.device.create_descriptor_pool(&info, None) }
            .map_err(Error::of("vkCreateDescriptorPool"))?;
        self.descriptor_pools.push(pool);
        Ok(())
    }

    /// Submits and waits for the end, as long as the watchdog allows.
    pub fn run(&mut self) -> Result<(), Error> {
        self.device.check()?;
        let ended = self.submit();
        self.device.note(ended)
    }

    fn submit(&mut self) -> Result<(), Error> {
        let device = &self.device.device;
        let buffers = [self.buffer];
        let submits = [vk::SubmitInfo::default().command_buffers(&buffers)];
        let fences = [self.fence];
        let queue = self.device.hold_queue();
        // SAFETY: `&mut self`: this command buffer is not in flight; the queue is held for the
        // submission alone; the fence is unsignalled before and reset after.
        unsafe {
            device
                .queue_submit(*queue.raw, &submits, self.fence)
                .map_err(Error::of("vkQueueSubmit"))?;
            drop(queue);
            let watchdog = self.device.watchdog;
            device.wait_for_fences(&fences, true, watchdog).map_err(|result| match result {
                vk::Result::TIMEOUT => Error::Hung { milliseconds: watchdog / 1_000_000 },
                result => Error::of("vkWaitForFences")(result),
            })?;
            device.reset_fences(&fences).map_err(Error::of("vkResetFences"))
        }
    }

    /// What was recorded.
    pub fn counts(&self) -> CommandCounts {
        self.counts
    }

    /// What was recorded up to each mark of a name.
    pub fn counts_at(&self, name: &'static str) -> impl Iterator<Item = CommandCounts> {
        self.marked.iter().filter(move |(marked, _)| *marked == name).map(|(_, counts)| *counts)
    }

    /// Device times of the last run's stages, in order; empty if the recording does not time them.
    pub fn stage_times(&self) -> Result<Vec<StageTime>, Error> {
        let ticks = self.read_ticks()?;
        let to_ms = f64::from(self.device.timestamp_period) * 1e-6;
        let stages = std::iter::zip(&self.timed, ticks.windows(2)).filter(|((_, stage), _)| *stage);
        let times = stages.map(|(&(name, _), t)| StageTime {
            name,
            milliseconds: t[1].saturating_sub(t[0]) as f64 * to_ms,
        });
        Ok(times.collect())
    }

    /// When the last run reached the marks of a name: milliseconds since its start. Drop the iterator before times are
    /// read again: it holds the lock of their memory.
    pub fn marks(&self, name: &'static str) -> Result<impl Iterator<Item = f64>, Error> {
        let ticks = self.read_ticks()?;
        let to_ms = f64::from(self.device.timestamp_period) * 1e-6;
        let marks =
            self.timed.iter().enumerate().filter(move |(_, (n, stage))| !stage && *n == name);
        Ok(marks.map(move |(i, _)| ticks[i + 1].saturating_sub(ticks[0]) as f64 * to_ms))
    }

    /// The queries of the last run, in memory that is kept.
    fn read_ticks(&self) -> Result<MutexGuard<'_, Vec<u64>>, Error> {
        let mut ticks = self.ticks.lock().unwrap_or_else(|e| e.into_inner());
        ticks.clear();
        if self.timed.is_empty() {
            return Ok(ticks);
        }
        ticks.resize(self.timed.len() + 1, 0);
        // SAFETY: all these queries were written by the last run, which has ended.
        let read = unsafe {
            let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
            self.device.device.get_query_pool_results(self.queries, 0, &mut ticks[..], flags)
        };
        self.device.note(read.map_err(Error::of("vkGetQueryPoolResults")))?;
        Ok(ticks)
    }
}
