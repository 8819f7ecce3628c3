//! The GPUs of this machine as a user chooses among them, without opening one.
#![allow(unsafe_code)]

use ash::vk;
use wgpu::hal::vulkan;

use super::adapter::find_adapters;
use super::{AdapterInfo, is_software};

/// A GPU, in the place that [`GpuChoice::Index`](super::GpuChoice::Index) counts.
#[derive(Clone, Debug)]
pub struct ListedGpu {
    pub info: AdapterInfo,
    /// Bytes of its largest heap of its own; `None` of a software adapter, which has the machine's memory.
    pub memory_bytes: Option<u64>,
    /// Whether it can read boxes and write masks where they lie in shared memory.
    pub imports_host_memory: bool,
}

/// All adapters that Vulkan's loader finds.
pub fn list_gpus() -> Vec<ListedGpu> {
    find_adapters().iter().map(listed).collect()
}

/// Whether there is Vulkan's loader, by which drivers are found.
pub fn has_vulkan_loader() -> bool {
    // SAFETY: the loader of the system, which is loaded to list adapters too. Nothing is called in it.
    unsafe { ash::Entry::load() }.is_ok()
}

fn listed(adapter: &wgpu::Adapter) -> ListedGpu {
    let info = adapter.get_info();
    // SAFETY: the guard is only read from, and dropped before the adapter.
    let Some(hal) = (unsafe { adapter.as_hal::<vulkan::Api>() }) else {
        return ListedGpu { info, memory_bytes: None, imports_host_memory: false };
    };
    let extension = ash::ext::external_memory_host::NAME;
    let imports_host_memory = hal.physical_device_capabilities().supports_extension(extension);
    let instance = hal.shared_instance().raw_instance();
    let physical = hal.raw_physical_device();
    // SAFETY: the adapter's handle, alive as long as the instance, which `hal` keeps alive.
    let memory = unsafe { instance.get_physical_device_memory_properties(physical) };
    let own = memory
        .memory_heaps_as_slice()
        .iter()
        .filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
        .map(|heap| heap.size)
        .max();
    ListedGpu { memory_bytes: own.filter(|_| !is_software(&info)), info, imports_host_memory }
}
