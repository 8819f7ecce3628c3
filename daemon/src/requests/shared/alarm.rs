//! The thread that ends ticks whose deadline has passed. It sleeps until the next one.

use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::Instant;

use pairmask_core::engine::CullError;

use super::locked;
use super::scene::SharedScene;
use crate::execute::EnginePool;
use crate::publish::{Outbox, Refusal};

/// Ends ticks at their deadlines. Dropped, it stops its thread.
pub(super) struct Alarm {
    shared: Arc<Shared>,
    pool: Arc<EnginePool>,
    thread: OnceLock<Option<JoinHandle<()>>>,
}

#[derive(Default)]
struct Shared {
    due: Mutex<Due>,
    changed: Condvar,
}

#[derive(Default)]
struct Due {
    /// Deadlines, one a scene. A scene whose tick has ended meanwhile is looked at in vain.
    scenes: Vec<(Instant, Weak<SharedScene>)>,
    stops: bool,
}

impl Due {
    /// Has a scene's tick end at a time, once. Whether that is sooner than it was.
    fn set(&mut self, at: Instant, scene: Weak<SharedScene>) -> bool {
        let known = self.scenes.iter_mut().find(|(_, known)| known.ptr_eq(&scene));
        match known {
            // An earlier look finds the tick open, and is set again.
            Some((known, _)) if *known <= at => return false,
            Some((known, _)) => *known = at,
            None => self.scenes.push((at, scene)),
        }
        true
    }
}

impl Alarm {
    pub(super) fn new(pool: Arc<EnginePool>) -> Self {
        Self { shared: Arc::default(), pool, thread: OnceLock::new() }
    }

    /// Starts the thread, once.
    ///
    /// # Errors
    /// Where the system has no thread.
    pub(super) fn start(&self, outbox: &Arc<Outbox>) -> Result<(), Refusal> {
        let thread = self.thread.get_or_init(|| {
            let (shared, pool) = (Arc::clone(&self.shared), Arc::clone(&self.pool));
            let outbox = Arc::clone(outbox);
            let builder = std::thread::Builder::new().name("deadlines".into());
            builder.spawn(move || watch(&shared, &pool, &outbox)).ok()
        });
        let engine = pairmask_core::engine::EngineName::CpuGrid;
        let no_thread = CullError::Unavailable { engine, why: "no thread for deadlines" };
        thread.as_ref().map(drop).ok_or_else(|| no_thread.into())
    }

    /// Has a scene's tick end at a time.
    pub(super) fn set(&self, at: Instant, scene: &Arc<SharedScene>) {
        let is_sooner = locked(&self.shared.due).set(at, Arc::downgrade(scene));
        if is_sooner {
            self.shared.changed.notify_one();
        }
    }
}

impl Drop for Alarm {
    fn drop(&mut self) {
        locked(&self.shared.due).stops = true;
        self.shared.changed.notify_one();
        if let Some(Some(thread)) = self.thread.take() {
            // One that panicked has ended the process.
            let _ = thread.join();
        }
    }
}

/// Ends the process where the thread panics, as a lane does: the supervisor starts another one.
struct EndWithPanic;

impl Drop for EndWithPanic {
    fn drop(&mut self) {
        if std::thread::panicking() {
            std::process::abort();
        }
    }
}

fn watch(shared: &Shared, pool: &EnginePool, outbox: &Outbox) {
    let _end = EndWithPanic;
    let mut due = locked(&shared.due);
    while !due.stops {
        let now = Instant::now();
        let rung: Vec<Weak<SharedScene>> =
            due.scenes.extract_if(.., |(at, _)| *at <= now).map(|(_, scene)| scene).collect();
        if rung.is_empty() {
            let next = due.scenes.iter().map(|(at, _)| *at).min();
            due = match next {
                Some(at) => {
                    let waited = shared.changed.wait_timeout(due, at - now);
                    waited.unwrap_or_else(PoisonError::into_inner).0
                }
                None => shared.changed.wait(due).unwrap_or_else(PoisonError::into_inner),
            };
            continue;
        }
        drop(due);
        let mut again = Vec::new();
        for scene in rung.iter().filter_map(Weak::upgrade) {
            scene.end_tick(pool, outbox);
            if let Some(at) = scene.closes_at() {
                again.push((at, Arc::downgrade(&scene)));
            }
        }
        due = locked(&shared.due);
        for (at, scene) in again {
            // A lane may have set it meanwhile.
            due.set(at, scene);
        }
    }
}
