//! The header of a request.

use bytemuck::{CheckedBitPattern, Pod, Zeroable};

use pairmask_core::engine::{EngineChoice, EngineName};

use crate::reject::Reject;
use crate::section::{SECTION_COUNT, Section};
use crate::{REQUEST_MAGIC, VERSION_MAJOR, VERSION_MINOR, Version};

/// Header of a request, 272 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct RequestHeader {
    /// [`REQUEST_MAGIC`].
    pub magic: u32,
    /// [`VERSION_MAJOR`].
    pub version_major: u16,
    /// [`VERSION_MINOR`].
    pub version_minor: u16,
    /// An [`Operation`].
    pub operation: u32,
    /// Of a cull: 1 an engine finds the pairs, also where the frame is equal to the last one (since 1.4).
    /// Unknown flags are ignored. Of an edit: the low half of a number of pairs (since 1.13).
    pub flags: u32,
    /// The client's number: an echo.
    pub client_token: u64,
    /// The client's number of this frame, echoed in the response.
    pub frame: u64,
    /// Boxes or spheres in the scene.
    pub box_count: u32,
    /// An [`EngineName`](pairmask_core::engine::EngineName), or 0 for the plan's choice.
    pub engine: u32,
    /// An [`Encoding`](pairmask_core::mask::Encoding), or 0 for the plan's choice. In an edit: what it asks for.
    pub encoding: u32,
    /// Threads that the engine may use, or 0 for the plan's choice.
    pub threads: u32,
    /// What lies where in the payload.
    pub sections: [Section; SECTION_COUNT],
    /// Threads with which the client iterates over the pairs, or 0 for one (since 1.3; a hint, which older
    /// readers ignore). Of an edit: the high half of a number of pairs (since 1.13).
    pub iterate_threads: u32,
    /// The client's number of a scene; zero in a cull (since 1.4).
    pub scene: u32,
    /// The revision of the scene that an edit is for, 0 to begin it; zero in a cull (since 1.4).
    pub base: u64,
    /// The revision that an edit makes (since 1.4). Of a cull with rules, the number under which the daemon
    /// keeps them (since 1.9); else zero in a cull.
    pub revision: u64,
    /// Indices of a scene are below this (since 1.4). Of a cull between two sets, boxes of the first set
    /// (since 1.7); else zero in a cull.
    pub most_boxes: u32,
    /// Flags of an edit; zero in a cull (since 1.4).
    pub scene_flags: u32,
}

const _: () = assert!(size_of::<RequestHeader>() == 272 && align_of::<RequestHeader>() == 8);

impl Default for RequestHeader {
    /// All zero. Not a valid request.
    fn default() -> Self {
        Self::zeroed()
    }
}

/// The operation that a request asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, CheckedBitPattern)]
#[repr(u32)]
pub enum Operation {
    /// Find the overlapping pairs of the boxes or spheres.
    Cull = 1,
    /// Report the daemon's status.
    Status = 2,
    /// Change a scene that the daemon keeps, and report what follows.
    EditScene = 3,
    /// End a scene.
    EndScene = 4,
    /// Find the boxes of a scene that other boxes overlap.
    QueryScene = 5,
    /// Find the overlapping pairs of a box of one set and a box of another.
    CullBetween = 6,
    /// Join a scene that several sessions write.
    JoinShared = 7,
    /// Lease indices of such a scene, or give them back.
    LeaseShared = 8,
    /// Change one's boxes of such a scene, and report what follows when the tick ends.
    CommitShared = 9,
    /// Leave such a scene.
    LeaveShared = 10,
    /// Find the boxes of a scene that rays hit or spheres touch.
    CastScene = 11,
    /// Report which boxes of a scene that several sessions write changed after a tick (since 1.15).
    ObserveShared = 12,
}

impl RequestHeader {
    /// A header with what every request has, else zero.
    pub(crate) fn envelope(operation: Operation, client_token: u64, frame: u64) -> Self {
        Self {
            magic: REQUEST_MAGIC,
            version_major: VERSION_MAJOR,
            version_minor: VERSION_MINOR,
            operation: operation as u32,
            client_token,
            frame,
            ..Self::zeroed()
        }
    }

    /// The client's version.
    pub(crate) const fn version(&self) -> Version {
        Version { major: self.version_major, minor: self.version_minor }
    }

    pub(crate) fn engine_choice(&self) -> Result<EngineChoice, Reject> {
        let found = self.engine;
        if found == 0 {
            return Ok(EngineChoice::Auto);
        }
        EngineName::from_wire(found).map(EngineChoice::Only).ok_or(Reject::Engine(found))
    }
}

/// The wire's number of an engine that is asked for.
pub(crate) const fn engine_number(choice: EngineChoice) -> u32 {
    match choice {
        EngineChoice::Auto => 0,
        EngineChoice::Only(name) => name as u32,
    }
}

/// The wire's number of threads: 0 leaves them open.
pub(crate) fn thread_number(threads: Option<usize>) -> u32 {
    threads.map_or(0, |threads| u32::try_from(threads).unwrap_or(u32::MAX))
}

/// Threads by the wire's number.
pub(crate) fn threads_of(number: u32) -> Option<usize> {
    (number != 0).then_some(number as usize)
}
