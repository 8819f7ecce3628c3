//! Memory that decoded pairs are handed out in. A session keeps it from answer to answer: fresh pages cost
//! more than the pairs that are written into them.

use std::sync::{Arc, Mutex, PoisonError};

/// As many answers as a session holds at a time.
const KEPT: usize = 3;

/// A session's spare vectors.
#[derive(Clone, Default)]
pub struct Spares(Arc<Mutex<Vec<Vec<[u32; 2]>>>>);

impl Spares {
    fn all(&self) -> std::sync::MutexGuard<'_, Vec<Vec<[u32; 2]>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Decoded pairs, once they are asked for. Their memory goes back when they are dropped.
pub struct Decoded {
    pairs: Option<Vec<[u32; 2]>>,
    spares: Spares,
}

impl Decoded {
    /// Nothing decoded yet.
    pub const fn new(spares: Spares) -> Self {
        Self { pairs: None, spares }
    }

    /// The session's.
    pub const fn spares(&self) -> &Spares {
        &self.spares
    }

    /// The pairs, which `decode` appends the first time.
    pub fn get(&mut self, decode: impl FnOnce(&mut Vec<[u32; 2]>)) -> &[[u32; 2]] {
        self.pairs.get_or_insert_with(|| {
            let mut pairs = self.spares.all().pop().unwrap_or_default();
            pairs.clear();
            decode(&mut pairs);
            pairs
        })
    }
}

impl Drop for Decoded {
    fn drop(&mut self) {
        if let Some(pairs) = self.pairs.take() {
            let mut all = self.spares.all();
            if all.len() < KEPT {
                all.push(pairs);
            }
        }
    }
}
