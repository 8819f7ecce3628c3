//! Memory that a GPU sees: in video memory, in host memory, or imported from a mapping.
//!
//! The CPU touches a block only between frames: an engine that submits a frame waits for its end
//! before it reads or writes, so neither side sees the other's half-written bytes.
#![allow(unsafe_code)]

use std::ptr::NonNull;
use std::sync::Arc;

use ash::vk;
use bytemuck::Pod;
use pairmask_core::engine::RecentNeed;

use super::device::find_memory_type;
use super::{Gpu, GpuError, ReadWriteMapping};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Home {
    /// Video memory that only the GPU sees.
    Video,
    /// Video memory that the CPU can write to, across the link. Never read it on the CPU
    /// (0.05 GB/s).
    MappedVideo,
    /// Host memory made by the driver, cached by the CPU.
    Host,
    Imported,
}

impl Home {
    /// Where the CPU writes what stages read: into video memory where it can, else read from afar.
    pub(super) fn written(gpu: &Gpu) -> Self {
        if gpu.limits().mapped_video_memory { Self::MappedVideo } else { Self::Host }
    }
}

pub struct Block {
    gpu: Arc<Gpu>,
    pub(super) home: Home,
    bytes: u64,
    pub(super) buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    host: Option<NonNull<u8>>,
    // Unmapped after the memory that was imported from it is freed (fields drop after `drop`).
    mapping: Option<ReadWriteMapping>,
}

// SAFETY: the handles may be used from any thread, and the host pointer is only followed by
// methods that the owner of the block serialises with frames (see the module's head).
unsafe impl Send for Block {}
// SAFETY: as above; `write` and `read` are only called between frames by the engine that owns it.
unsafe impl Sync for Block {}

const USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::STORAGE_BUFFER.as_raw()
        | vk::BufferUsageFlags::TRANSFER_SRC.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw(),
);

pub(super) const MAPPED: vk::MemoryPropertyFlags = vk::MemoryPropertyFlags::from_raw(
    vk::MemoryPropertyFlags::HOST_VISIBLE.as_raw()
        | vk::MemoryPropertyFlags::HOST_COHERENT.as_raw(),
);

/// A large page of GPUs in use.
const LARGE_PAGE_BYTES: u64 = 2 << 20;

impl Block {
    /// Makes a block of at least `bytes`, contents unspecified.
    pub fn new(gpu: &Arc<Gpu>, home: Home, bytes: u64) -> Result<Arc<Self>, GpuError> {
        use vk::MemoryPropertyFlags as Flags;
        // Whole pages, so that no two blocks share one and nothing is empty; large ones for large
        // blocks, so that scattered access finds its way.
        let page = if bytes >= LARGE_PAGE_BYTES / 2 { LARGE_PAGE_BYTES } else { 4096 };
        let bytes = bytes.max(1).next_multiple_of(page);
        let (needed, wished) = match home {
            Home::Video => (Flags::DEVICE_LOCAL, Flags::empty()),
            Home::MappedVideo => (MAPPED | Flags::DEVICE_LOCAL, Flags::empty()),
            Home::Host | Home::Imported => (MAPPED, Flags::HOST_CACHED),
        };
        let (mut block, requirements) = Self::unbound(gpu, home, bytes, None)?;
        let memory_type =
            find_memory_type(&gpu.memory, requirements.memory_type_bits, needed, wished)
                .ok_or(GpuError::OutOfMemory { bytes })?;
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(requirements.size)
            .memory_type_index(memory_type);
        block.allocate_and_bind(&info)?;
        if home != Home::Video {
            let (raw, all) = (&gpu.raw, vk::WHOLE_SIZE);
            // SAFETY: host-visible memory, mapped once, until it is freed.
            let mapped =
                unsafe { raw.map_memory(block.memory, 0, all, vk::MemoryMapFlags::empty()) }?;
            block.host = NonNull::new(mapped.cast());
        }
        Ok(Arc::new(block))
    }

    pub(super) fn import(gpu: &Arc<Gpu>, mapping: ReadWriteMapping) -> Result<Arc<Self>, GpuError> {
        let refused = GpuError::Driver(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE);
        let (Some(import), Some(align)) = (&gpu.host_import, gpu.limits().import_align_bytes)
        else {
            return Err(refused);
        };
        let bytes = mapping.bytes() as u64;
        let host = mapping.pointer();
        let whole = |value: u64| value.is_multiple_of(align);
        if bytes == 0 || !whole(bytes) || !whole(host.as_ptr() as u64) {
            return Err(refused);
        }
        let handle_type = vk::ExternalMemoryHandleTypeFlags::HOST_ALLOCATION_EXT;
        let mut properties = vk::MemoryHostPointerPropertiesEXT::default();
        // SAFETY: the pointer starts a live mapping of `bytes` bytes, aligned as the driver asks.
        gpu.noticed(unsafe {
            (import.fp().get_memory_host_pointer_properties_ext)(
                gpu.raw.handle(),
                handle_type,
                host.as_ptr().cast(),
                &raw mut properties,
            )
            .result()
        })?;
        let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(handle_type);
        let made = Self::unbound(gpu, Home::Imported, bytes, Some(&mut external));
        let (mut block, requirements) = made?;
        let allowed = requirements.memory_type_bits & properties.memory_type_bits;
        let cached = vk::MemoryPropertyFlags::HOST_CACHED;
        let memory_type = find_memory_type(&gpu.memory, allowed, MAPPED, cached).ok_or(refused)?;
        let mut pointer = vk::ImportMemoryHostPointerInfoEXT::default()
            .handle_type(handle_type)
            .host_pointer(host.as_ptr().cast());
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(bytes)
            .memory_type_index(memory_type)
            .push_next(&mut pointer);
        // The CPU sees these pages through its own mapping of them.
        block.mapping = Some(mapping);
        block.allocate_and_bind(&info)?;
        Ok(Arc::new(block))
    }

    /// A block without memory, and what memory fits it. It destroys what it has, also when a later step fails.
    fn unbound(
        gpu: &Arc<Gpu>,
        home: Home,
        bytes: u64,
        external: Option<&mut vk::ExternalMemoryBufferCreateInfo<'_>>,
    ) -> Result<(Self, vk::MemoryRequirements), GpuError> {
        let families: Vec<u32> = gpu.families.into_iter().flatten().collect();
        let mut info = vk::BufferCreateInfo::default().size(bytes).usage(USAGE);
        if families.len() > 1 {
            // All of them use it without handing it over, which costs buffers nothing.
            info = info.sharing_mode(vk::SharingMode::CONCURRENT).queue_family_indices(&families);
        }
        if let Some(external) = external {
            info = info.push_next(external);
        }
        // SAFETY: a plain buffer on a device that outlives it (`gpu` is kept); who imports external memory has
        // the extension.
        let buffer = gpu.noticed(unsafe { gpu.raw.create_buffer(&info, None) })?;
        // SAFETY: the buffer was made above.
        let requirements = unsafe { gpu.raw.get_buffer_memory_requirements(buffer) };
        let (gpu, memory) = (Arc::clone(gpu), vk::DeviceMemory::null());
        let block = Self { gpu, home, bytes, buffer, memory, host: None, mapping: None };
        Ok((block, requirements))
    }

    fn allocate_and_bind(&mut self, info: &vk::MemoryAllocateInfo<'_>) -> Result<(), GpuError> {
        let (gpu, bytes) = (&self.gpu, self.bytes);
        // SAFETY: the info names a memory type of this device.
        let allocated = gpu.noticed(unsafe { gpu.raw.allocate_memory(info, None) });
        self.memory = allocated.map_err(|error| match error {
            GpuError::OutOfMemory { .. } => GpuError::OutOfMemory { bytes },
            other => other,
        })?;
        // SAFETY: both are fresh and of fitting size and type.
        gpu.noticed(unsafe { gpu.raw.bind_buffer_memory(self.buffer, self.memory, 0) })
    }

    pub fn bytes(&self) -> u64 {
        self.bytes
    }
    /// Copies `values` to byte `offset`. Call it between frames only.
    ///
    /// # Panics
    /// Outside the block, or on one that the CPU does not see through it (video memory, imports).
    pub fn write<T: Pod>(&self, offset: u64, values: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let to = self.host_range(offset, bytes.len());
        // SAFETY: `host_range` checked the range; no frame runs (module's head), and `values`
        // does not lie in this block, which hands out no references.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), to, bytes.len()) };
    }

    /// As [`Self::write`], from byte `offset` into `values`.
    pub fn read<T: Pod>(&self, offset: u64, values: &mut [T]) {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(values);
        let from = self.host_range(offset, bytes.len());
        // SAFETY: as in `write`.
        unsafe { std::ptr::copy_nonoverlapping(from, bytes.as_mut_ptr(), bytes.len()) };
    }

    fn host_range(&self, offset: u64, len: usize) -> *mut u8 {
        let end = offset.checked_add(len as u64);
        assert!(end.is_some_and(|end| end <= self.bytes), "outside the block");
        let Some(host) = self.host else { panic!("the CPU cannot see {:?} memory", self.home) };
        // SAFETY: the range was checked to lie within the block.
        unsafe { host.as_ptr().add(offset as usize) }
    }
}

impl Drop for Block {
    fn drop(&mut self) {
        // SAFETY: frames that use the block keep it alive until they have ended; freeing memory
        // unmaps it; a null handle is ignored.
        unsafe {
            self.gpu.raw.destroy_buffer(self.buffer, None);
            self.gpu.raw.free_memory(self.memory, None);
        }
    }
}

#[derive(Clone)]
pub struct Part {
    pub(super) block: Arc<Block>,
    pub(super) offset: u64,
    /// How many: the range lies within the block ([`Part::of`]).
    pub(super) bytes: u64,
}

impl Part {
    pub fn whole(block: &Arc<Block>) -> Self {
        Self { block: Arc::clone(block), offset: 0, bytes: block.bytes }
    }

    /// A range of a block.
    ///
    /// # Panics
    /// Outside the block, where the GPU would read and write memory that is not the block's.
    pub fn of(block: &Arc<Block>, offset: u64, bytes: u64) -> Self {
        let end = offset.checked_add(bytes);
        assert!(end.is_some_and(|end| end <= block.bytes), "a part lies within its block");
        Self { block: Arc::clone(block), offset, bytes }
    }
}

/// Declares what stages hand each other, by the names that their texts give it, each with its home: the blocks of an
/// engine, which grow with the scenes, and the parts of a frame.
macro_rules! frame_blocks {
    ($scratch:ident, $blocks:ident: $($name:ident in $home:ident),+ $(,)?) => {
        pub(super) struct $scratch {
            $($name: Growing,)+
        }

        #[derive(Clone)]
        pub(super) struct $blocks {
            $(pub(super) $name: Part,)+
        }

        impl $scratch {
            pub(super) const fn new() -> Self {
                Self { $($name: Growing::new(Home::$home),)+ }
            }
        }

        impl $blocks {
            pub(super) fn named(&self) -> Vec<(&'static str, &Part)> {
                vec![$((stringify!($name), &self.$name),)+]
            }
        }
    };
}
pub(super) use frame_blocks;

/// A block that is made anew, larger, when more is asked of it, and smaller when much less is.
pub(super) struct Growing {
    home: Home,
    block: Option<Arc<Block>>,
    need: RecentNeed,
}

impl Growing {
    pub(super) const fn new(home: Home) -> Self {
        Self { home, block: None, need: RecentNeed::NONE }
    }

    pub(super) fn held_bytes(&self) -> u64 {
        self.block.as_ref().map_or(0, |block| block.bytes())
    }

    /// The first `bytes` of a block, which is smaller when much less was asked of it for some dozens of frames.
    /// `replaced` is set if it is not the one of last time.
    pub(super) fn part(
        &mut self,
        gpu: &Arc<Gpu>,
        bytes: u64,
        replaced: &mut bool,
    ) -> Result<Part, GpuError> {
        let held = self.held_bytes() as usize;
        let most = if self.need.note(bytes as usize, || held) { 0 } else { u64::MAX };
        self.at_least(gpu, bytes, most, replaced).map(|block| Part::of(block, 0, bytes))
    }

    /// A block of `bytes` to `most` where it was there. `replaced` is set if it is another.
    pub(super) fn at_least(
        &mut self,
        gpu: &Arc<Gpu>,
        bytes: u64,
        most: u64,
        replaced: &mut bool,
    ) -> Result<&Arc<Block>, GpuError> {
        let kept = self.block.take().filter(|block| (bytes..=most).contains(&block.bytes()));
        let block = if let Some(block) = kept {
            block
        } else {
            *replaced = true;
            // A quarter more, so that a slowly growing scene does not allocate each frame; the
            // bare size when that is too much.
            let roomy = Block::new(gpu, self.home, bytes + bytes / 4);
            roomy.or_else(|_| Block::new(gpu, self.home, bytes))?
        };
        Ok(self.block.insert(block))
    }
}
