//! Second slots of boxes: those of what a box was that has gone too far for one slot.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// Places of ghosts by the index of their box.
pub(super) type Ghosts = HashMap<u32, u32, BuildHasherDefault<IndexHasher>>;

/// Mixes an index. Nothing depends on the order of the table, and a client that makes indices collide
/// slows its own scene.
#[derive(Debug, Default)]
pub(super) struct IndexHasher(u64);

impl Hasher for IndexHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.write_u32(u32::from(*byte));
        }
    }

    fn write_u32(&mut self, index: u32) {
        // 2^64 / φ; the table takes its bits from both ends.
        let mixed = (self.0 ^ u64::from(index)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ mixed >> 32;
    }
}
