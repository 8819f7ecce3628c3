//! Tasks run on the calling thread's rayon pool, each with its own part of the reply.
//!
//! Halving with `join` needs no list of jobs, so that a steady frame allocates nothing. Each task runs
//! with the default floating-point flags, whatever those of the thread that it falls to.

use super::task::Task;
use crate::engine::encode::DenseWindow;
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

/// Runs `work` on every task with the part of `window` that holds its rows; the window is that of the
/// rows of all tasks.
pub(super) fn for_each_window(
    tasks: &mut [Task],
    window: DenseWindow<'_>,
    work: &(impl Fn(&mut Task, DenseWindow<'_>) + Sync),
) {
    match tasks {
        [] => {}
        [task] => floats::with_default(|| work(task, window)),
        many => {
            let (low, high) = many.split_at_mut(many.len() / 2);
            let (low_rows, high_rows) = window.split_at_row(high[0].rows().start);
            rayon::join(
                || for_each_window(low, low_rows, work),
                || for_each_window(high, high_rows, work),
            );
        }
    }
}
