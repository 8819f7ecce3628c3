//! The opened device: raw Vulkan handles beside the wgpu device that owns them.
//!
//! wgpu lists the adapters, opens the device and reports its loss. Frames are recorded and
//! submitted through `ash`: a frame recorded once and submitted many times takes half the time of
//! one that wgpu records anew (15 µs against 29 on an H200).
#![allow(unsafe_code)]

use std::sync::{Arc, Mutex};

use ash::vk;
use pairmask_core::EngineName;
use pairmask_core::engine::CullError;
use wgpu::hal::vulkan;

use super::adapter::find_adapter;
use super::memory::MAPPED;
use super::{AdapterInfo, DeviceHealth, GpuChoice, GpuError, OpenError, is_software};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpuLimits {
    /// Largest part of a buffer that a stage can see.
    pub storage_binding_bytes: u64,
    /// A binding starts on a multiple of this.
    pub storage_offset_align_bytes: u64,
    /// Workgroups along one dimension of a dispatch.
    pub dispatch_groups: u32,
    /// Imported host memory starts and ends on a multiple of this; `None` without import.
    pub import_align_bytes: Option<u64>,
    pub mapped_video_memory: bool,
    pub timestamp_period_ns: f32,
    pub int64: bool,
    /// Rounds of all its loops that a thread may take; [`u32::MAX`] where there is no limit.
    pub thread_rounds: u32,
}

/// [`GpuLimits::thread_rounds`] of a software adapter. lavapipe ends all loops of a thread after 65,535 rounds
/// together, silently, and runs eight threads side by side, each of which may keep the others waiting.
const SOFTWARE_THREAD_ROUNDS: u32 = 65_535 / 8;

/// Submissions that may be under way at a time: the CPU gets the next one ready while the device works.
pub const SUBMISSIONS: usize = 2;

/// What a queue is for. Each role has a family of queues of its own, where the device has such, so
/// that the work of one does not wait for another's. Two queues of one family would not do: on an
/// H200 they take turns, 100 µs and more at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QueueRole {
    /// The stages of frames; wgpu's queue.
    Frames,
    /// Boxes of the next frame to video memory meanwhile: a family that only copies.
    Upload,
    /// What keeps the clocks up between frames: a family that computes and draws nothing.
    Awake,
}

const ROLES: usize = 3;

/// An opened GPU. Everything made on it holds an `Arc` of it, so it closes last.
pub struct Gpu {
    info: AdapterInfo,
    limits: GpuLimits,
    health: Arc<DeviceHealth>,
    pub(super) raw: ash::Device,
    queues: Mutex<[Option<vk::Queue>; ROLES]>,
    pub(super) families: [Option<u32>; ROLES],
    pub(super) memory: vk::PhysicalDeviceMemoryProperties,
    pub(super) host_import: Option<ash::ext::external_memory_host::Device>,
    /// Identifies adapter, driver version and cache format, for the pipeline cache's file name.
    pub(super) cache_key: String,
    // Owns the raw device and destroys it on drop, after every use above.
    wgpu_device: wgpu::Device,
    _wgpu_queue: wgpu::Queue,
}

impl GpuLimits {
    /// Most bytes that a stage sees of a block: it counts them in 32 bits.
    pub(super) fn binding_bytes(&self) -> u64 {
        self.storage_binding_bytes.min(1 << 31)
    }
}

/// Whether the device may import host memory. `Never` is for tests of the staged path.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HostImport {
    #[default]
    IfPossible,
    Never,
}

impl Gpu {
    pub fn open(choice: &GpuChoice, host_import: HostImport) -> Result<Arc<Self>, OpenError> {
        let adapter = find_adapter(choice)?;
        // Drivers start threads here, which inherit the floating-point flags of this one. A software
        // adapter computes cells on them, so they must all have the same.
        let open = || Self::open_adapter(&adapter, host_import).map(Arc::new);
        pairmask_core::floats::with_default(open)
    }

    fn open_adapter(adapter: &wgpu::Adapter, host_import: HostImport) -> Result<Self, OpenError> {
        let info = adapter.get_info();
        let features = adapter.features()
            & (wgpu::Features::TIMESTAMP_QUERY
                | wgpu::Features::SUBGROUP
                | wgpu::Features::SHADER_INT64
                | wgpu::Features::IMMEDIATES);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("pairmask"),
            required_features: features,
            required_limits: adapter.limits(),
            ..Default::default()
        };
        // SAFETY: the guard is only read from and dropped before the adapter.
        let hal = unsafe { adapter.as_hal::<vulkan::Api>() }
            .ok_or_else(|| OpenError::NotVulkan(info.name.clone()))?;
        let extension = ash::ext::external_memory_host::NAME;
        let import = host_import == HostImport::IfPossible
            && hal.physical_device_capabilities().supports_extension(extension);
        let instance = hal.shared_instance().raw_instance().clone();
        let physical = hal.raw_physical_device();
        // SAFETY: the adapter's handle, alive as long as the instance, which `hal` keeps alive.
        let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
        let mut families = side_families(&families);
        // SAFETY: the callback adds one extension that the driver lists and a queue of families that
        // the device has, and removes nothing.
        let opened = unsafe {
            hal.open_with_callback(
                features,
                &descriptor.required_limits,
                &descriptor.memory_hints,
                Some(Box::new(|args| {
                    if import {
                        args.extensions.push(extension);
                    }
                    for family in &mut families {
                        let has_it = |info: &vk::DeviceQueueCreateInfo<'_>| {
                            Some(info.queue_family_index) == *family
                        };
                        if args.queue_create_infos.iter().any(has_it) {
                            *family = None;
                        }
                        args.queue_create_infos.extend(family.map(|family| {
                            vk::DeviceQueueCreateInfo::default()
                                .queue_family_index(family)
                                .queue_priorities(&[1.0])
                        }));
                    }
                })),
            )
        }?;
        drop(hal);
        // SAFETY: `opened` was opened from this adapter with the features of the descriptor.
        let (device, queue) =
            unsafe { adapter.create_device_from_hal::<vulkan::Api>(opened, &descriptor) }?;
        let health = Arc::new(DeviceHealth::default());
        watch(&device, &health);

        let (raw, raw_queue, queue_family) = {
            // SAFETY: handles are copied; `wgpu_device` below outlives every use of them.
            let hal = unsafe { device.as_hal::<vulkan::Api>() }
                .ok_or_else(|| OpenError::NotVulkan(info.name.clone()))?;
            (hal.raw_device().clone(), hal.raw_queue(), hal.queue_family_index())
        };
        // SAFETY: the device was made with a queue of each of these families.
        let queue_of = |family| unsafe { raw.get_device_queue(family, 0) };
        let [upload, awake] = families.map(|family| family.map(queue_of));
        let queues = [Some(raw_queue), upload, awake];
        // SAFETY: `physical` is the adapter's handle, alive as long as the instance, which wgpu's
        // device keeps alive.
        let memory = unsafe { instance.get_physical_device_memory_properties(physical) };
        let mut host = vk::PhysicalDeviceExternalMemoryHostPropertiesEXT::default();
        let mut properties = vk::PhysicalDeviceProperties2::default();
        if import {
            properties = properties.push_next(&mut host);
        }
        // SAFETY: as above; the chained struct belongs to an extension that the driver lists.
        unsafe { instance.get_physical_device_properties2(physical, &mut properties) };
        let properties = properties.properties;
        let limits = GpuLimits {
            storage_binding_bytes: u64::from(properties.limits.max_storage_buffer_range),
            storage_offset_align_bytes: properties.limits.min_storage_buffer_offset_alignment,
            dispatch_groups: properties.limits.max_compute_work_group_count[0]
                .min(properties.limits.max_compute_work_group_count[1]),
            import_align_bytes: import.then_some(host.min_imported_host_pointer_alignment),
            mapped_video_memory: find_memory_type(&memory, u32::MAX, MAPPED_VIDEO, MAPPED_VIDEO)
                .is_some(),
            timestamp_period_ns: properties.limits.timestamp_period,
            int64: features.contains(wgpu::Features::SHADER_INT64),
            thread_rounds: if is_software(&info) { SOFTWARE_THREAD_ROUNDS } else { u32::MAX },
        };
        let uuid = u128::from_be_bytes(properties.pipeline_cache_uuid);
        let cache_key = format!(
            "{:04x}-{:04x}-{:08x}-{uuid:032x}",
            properties.vendor_id, properties.device_id, properties.driver_version
        );
        let host_import =
            import.then(|| ash::ext::external_memory_host::Device::new(&instance, &raw));
        Ok(Self {
            info,
            limits,
            health,
            raw,
            families: [Some(queue_family), families[0], families[1]],
            queues: Mutex::new(queues),
            memory,
            host_import,
            cache_key,
            wgpu_device: device,
            _wgpu_queue: queue,
        })
    }

    pub fn info(&self) -> &AdapterInfo {
        &self.info
    }

    pub fn is_software(&self) -> bool {
        is_software(&self.info)
    }

    pub fn limits(&self) -> &GpuLimits {
        &self.limits
    }

    pub fn health(&self) -> &DeviceHealth {
        &self.health
    }

    /// Destroys the device as a fault would. For tests of the recovery.
    pub fn destroy(&self) {
        self.wgpu_device.destroy();
        // wgpu calls back only when it next looks after the device, and we never ask it to.
        self.health.mark_lost();
    }

    /// Whether a role has a queue of its own. Without one, its work is the frames' queue's.
    pub(super) fn has_own_queue(&self, role: QueueRole) -> bool {
        self.families[role as usize].is_some()
    }

    pub(super) fn family(&self, role: QueueRole) -> Option<u32> {
        self.families[role as usize].or(self.families[QueueRole::Frames as usize])
    }

    pub(super) fn submit(
        &self,
        role: QueueRole,
        commands: vk::CommandBuffer,
        order: Order,
        fence: vk::Fence,
    ) -> Result<(), GpuError> {
        self.health.check()?;
        let buffers = [commands];
        let Order { after, before } = order;
        let stages = [vk::PipelineStageFlags::ALL_COMMANDS];
        let info = vk::SubmitInfo::default()
            .command_buffers(&buffers)
            .wait_semaphores(after.as_slice())
            .wait_dst_stage_mask(&stages[..after.as_slice().len()])
            .signal_semaphores(before.as_slice());
        let queues = self.queues.lock().map_err(|_| GpuError::Lost)?;
        let own = queues[role as usize].or(queues[QueueRole::Frames as usize]);
        let queue = own.ok_or(GpuError::Lost)?;
        // SAFETY: the lock synchronises the queues; commands, fence and semaphore belong to this
        // device and are not pending (their frame waits for its end before it is submitted again).
        let result = unsafe { self.raw.queue_submit(queue, &[info], fence) };
        self.noticed(result)
    }

    /// The error for an engine's caller. A device that does what it should not counts as lost.
    pub(super) fn cull_error(&self, engine: EngineName, error: &GpuError) -> CullError {
        match *error {
            GpuError::OutOfMemory { bytes } => {
                CullError::DeviceMemory { engine, needed_bytes: bytes }
            }
            GpuError::Lost | GpuError::Hung | GpuError::Driver(_) | GpuError::Stage { .. } => {
                log::error!("{engine}: {error}");
                self.health.mark_lost();
                CullError::DeviceLost { engine }
            }
        }
    }

    /// Passes a driver's answer on; a lost device is remembered.
    pub(super) fn noticed<T>(&self, result: Result<T, vk::Result>) -> Result<T, GpuError> {
        result.map_err(|error| {
            let error = GpuError::from(error);
            if error == GpuError::Lost {
                self.health.mark_lost();
            }
            error
        })
    }
}

const MAPPED_VIDEO: vk::MemoryPropertyFlags = vk::MemoryPropertyFlags::from_raw(
    vk::MemoryPropertyFlags::DEVICE_LOCAL.as_raw() | MAPPED.as_raw(),
);

/// The families of [`QueueRole::Upload`] and [`QueueRole::Awake`], where there are such.
fn side_families(families: &[vk::QueueFamilyProperties]) -> [Option<u32>; ROLES - 1] {
    use vk::QueueFlags as Flags;
    let find = |requested: Flags, unwanted: Flags| {
        let fits = |flags: Flags| flags.contains(requested) && !flags.intersects(unwanted);
        families.iter().zip(0u32..).find(|(f, _)| fits(f.queue_flags)).map(|(_, index)| index)
    };
    let special = Flags::VIDEO_DECODE_KHR | Flags::VIDEO_ENCODE_KHR | Flags::OPTICAL_FLOW_NV;
    [
        find(Flags::TRANSFER, Flags::GRAPHICS | Flags::COMPUTE | special),
        find(Flags::COMPUTE, Flags::GRAPHICS),
    ]
}

/// Alone by default.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Order {
    /// It begins when this is signalled.
    pub(super) after: Option<vk::Semaphore>,
    /// Its end signals this.
    pub(super) before: Option<vk::Semaphore>,
}

/// A memory type among `allowed` (a bit each) with all of `needed`, if possible `wished` too.
pub(super) fn find_memory_type(
    memory: &vk::PhysicalDeviceMemoryProperties,
    allowed: u32,
    needed: vk::MemoryPropertyFlags,
    wished: vk::MemoryPropertyFlags,
) -> Option<u32> {
    let types = || memory.memory_types_as_slice().iter().zip(0u32..);
    let fits = |flags: vk::MemoryPropertyFlags| {
        types().find(|(ty, i)| allowed >> i & 1 == 1 && ty.property_flags.contains(flags))
    };
    fits(needed | wished).or_else(|| fits(needed)).map(|(_, i)| i)
}

/// Has wgpu report a loss, and errors outside of any call (which would panic otherwise).
fn watch(device: &wgpu::Device, health: &Arc<DeviceHealth>) {
    let lost = Arc::clone(health);
    device.set_device_lost_callback(move |reason, message| {
        log::warn!("the GPU device was lost ({reason:?}): {message}");
        lost.mark_lost();
    });
    let failed = Arc::clone(health);
    device.on_uncaptured_error(Arc::new(move |error| {
        log::error!("GPU error outside any call, the device is given up: {error}");
        failed.mark_lost();
    }));
}
