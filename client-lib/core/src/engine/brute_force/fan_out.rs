//! Tasks run on the calling thread's rayon pool, each with its own part of the reply.
//!
//! Halving with `join` needs no list of jobs, so that a steady frame allocates nothing. Each task runs
//! with the default floating-point flags, whatever those of the thread that it falls to.

use super::dense::first_word;
use super::task::Task;
use crate::floats;

/// Runs `work` on every task.
pub(super) fn for_each(tasks: &mut [Task], work: &(impl Fn(&mut Task) + Sync)) {
    match tasks {
        [] => {}
        [task] => floats::with_default(|| work(task)),
        many => {
            let (low, high) = many.split_at_mut(many.len() / 2);
            rayon::join(|| for_each(low, work), || for_each(high, work));
        }
    }
}

/// Runs `work` on every task with its window of a dense mask of n boxes. `words` starts at the
/// first word of the first task and ends where the last task's window does.
pub(super) fn for_each_window(
    tasks: &mut [Task],
    words: &mut [u32],
    n: usize,
    work: &(impl Fn(&mut Task, &mut [u32]) + Sync),
) {
    match tasks {
        [] => {}
        [task] => floats::with_default(|| work(task, words)),
        many => {
            let (low, high) = many.split_at_mut(many.len() / 2);
            let border = first_word(high[0].rows().start, n) - first_word(low[0].rows().start, n);
            let (low_words, high_words) = words.split_at_mut(border as usize);
            rayon::join(
                || for_each_window(low, low_words, n, work),
                || for_each_window(high, high_words, n, work),
            );
        }
    }
}
