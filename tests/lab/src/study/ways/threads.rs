//! The numbers of threads that are measured, and their pools.

use std::sync::Arc;

use crate::Result;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// 1, 2, 4 … and `most`.
pub fn thread_counts(most: usize) -> Vec<usize> {
    let doubled = std::iter::successors(Some(1), |n| Some(2 * n)).take_while(|n| *n < most);
    doubled.chain([most]).collect()
}

/// Threads that this process may use.
pub fn core_count() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Thread pools, one for each number of threads.
pub struct Pools(Vec<Arc<ThreadPool>>);

impl Pools {
    /// One pool for each number of threads above 1.
    pub fn new(threads: &[usize]) -> Result<Self> {
        let more = threads.iter().filter(|threads| **threads > 1);
        let pool = |n: &usize| Ok(Arc::new(ThreadPoolBuilder::new().num_threads(*n).build()?));
        Ok(Self(more.map(pool).collect::<Result<_>>()?))
    }

    /// The pool of `threads` threads; `None` is the calling thread.
    pub fn of(&self, threads: usize) -> Option<Arc<ThreadPool>> {
        self.0.iter().find(|pool| pool.current_num_threads() == threads).cloned()
    }
}

#[cfg(test)]
mod tests {
    use super::thread_counts;

    #[test]
    fn threads_double_up_to_the_most() {
        assert_eq!(thread_counts(1), [1]);
        assert_eq!(thread_counts(2), [1, 2]);
        assert_eq!(thread_counts(6), [1, 2, 4, 6]);
        assert_eq!(thread_counts(8), [1, 2, 4, 8]);
    }
}
