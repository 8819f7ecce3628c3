//! A session's engines, and the memory that their scratch takes.

use pairmask_core::BoxCount;
use pairmask_transport::{Charge, Memory, OverBudget, Share};

use crate::execute::Executor;

/// Bytes of scratch that a frame takes for an object, at the most, beside three words for a word of its answer: keys and
/// records of the objects, twice where an engine hands over to another one, and what narrow ones are expanded to.
const SCRATCH_AN_OBJECT: u64 = 160;
/// Bytes that any frame takes.
const SCRATCH_A_FRAME: u64 = 96 << 10;

const fn scratch_of(objects: u32) -> u64 {
    SCRATCH_A_FRAME + SCRATCH_AN_OBJECT * objects as u64
}

pub(crate) struct SessionEngines {
    pub(crate) executor: Executor,
    room: Charge,
}

impl SessionEngines {
    pub(crate) fn new(executor: Executor, share: &Share) -> Self {
        Self { executor, room: share.nothing(Memory::Own) }
    }

    /// Makes room for a frame.
    pub(crate) fn make_room(&mut self, objects: BoxCount) -> Result<(), OverBudget> {
        self.room.grow_to(scratch_of(objects.get()))
    }

    /// Notes what the scratch takes by now.
    pub(crate) fn note_room(&mut self) {
        self.room.set(self.executor.scratch_bytes() as u64);
    }

    /// Gives up what no frame has needed for long.
    pub(super) fn tidy(&mut self) {
        self.executor.tidy();
        self.note_room();
    }
}

#[cfg(test)]
mod tests {
    use pairmask_core::dispatch::CullOptions;
    use pairmask_core::engine::HeapReply;
    use pairmask_core::{EngineChoice, EngineName};

    use super::*;
    use crate::execute::Owner;
    use crate::scene::{Scene, SceneName};

    #[test]
    fn scratch_is_foreseen() {
        for n in [100, 4_000, 60_000] {
            for name in SceneName::ALL {
                let scene = Scene::new(name, n, 1);
                let engines = EngineName::CPU.map(EngineChoice::Only);
                for engine in engines.into_iter().chain([EngineChoice::Auto]) {
                    let is_brute = engine == EngineChoice::Only(EngineName::CpuBrute);
                    if n > 4_000 && (is_brute || name == SceneName::Identical) {
                        continue;
                    }
                    let (mut executor, mut reply) = (Executor::new([]), HeapReply::new());
                    let options = CullOptions { engine, ..CullOptions::default() };
                    let boxes = scene.boxes().into();
                    let done = executor.cull(boxes, Owner::Caller, &options, &mut reply);
                    assert!(done.is_ok(), "{name} {n} {engine}");
                    let (bytes, words) = (executor.scratch_bytes(), reply.words().len());
                    let of_answer = 3 * size_of::<u32>() * words;
                    let foreseen = scratch_of(n as u32) + of_answer as u64;
                    assert!(bytes as u64 <= foreseen, "{name} {n} {engine}: {bytes} {foreseen}");
                }
            }
        }
    }
}
