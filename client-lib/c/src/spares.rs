//! Memory that decoded pairs are handed out in. A session keeps it from answer to answer: fresh pages cost
//! more than the pairs that are written into them.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// As many answers as a session holds at a time.
const KEPT: usize = 3;

/// A session's spare vectors.
#[derive(Clone, Default)]
pub struct Spares(Arc<Mutex<Vec<Vec<[u32; 2]>>>>);

impl Spares {
    fn all(&self) -> MutexGuard<'_, Vec<Vec<[u32; 2]>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// An empty vector, of a spare one's memory if there is one.
    pub fn take(&self) -> Vec<[u32; 2]> {
        let mut pairs = self.all().pop().unwrap_or_default();
        pairs.clear();
        pairs
    }

    pub fn give_back(&self, pairs: Vec<[u32; 2]>) {
        let mut all = self.all();
        if all.len() < KEPT {
            all.push(pairs);
        }
    }
}
