//! The pipeline cache that a caller keeps between starts.

use ash::vk;

use super::Error;

/// Bytes of the check at the end.
const CHECK: usize = 4;

/// Makes the device's cache of kept data. Drivers trust the data that they wrote, so it must be whole: else the cache
/// starts empty. Null if the driver makes none: then it compiles every time.
pub(super) fn open(device: &ash::Device, kept: &[u8]) -> vk::PipelineCache {
    let whole = kept.split_last_chunk::<CHECK>();
    let whole = whole.filter(|(data, check)| crc32fast::hash(data).to_le_bytes() == **check);
    let data = whole.map_or(&[][..], |(data, _)| data);
    let info = vk::PipelineCacheCreateInfo::default().initial_data(data);
    // SAFETY: a valid description. Data of another device or driver is told by its header, and left aside.
    let made = unsafe { device.create_pipeline_cache(&info, None) };
    made.unwrap_or(vk::PipelineCache::null())
}

/// The data to keep.
pub(super) fn read(device: &ash::Device, cache: vk::PipelineCache) -> Result<Vec<u8>, Error> {
    if cache == vk::PipelineCache::null() {
        return Ok(Vec::new());
    }
    // SAFETY: a cache of this device.
    let mut data = unsafe { device.get_pipeline_cache_data(cache) }
        .map_err(Error::of("vkGetPipelineCacheData"))?;
    let check = crc32fast::hash(&data);
    data.extend(check.to_le_bytes());
    Ok(data)
}
