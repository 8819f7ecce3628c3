//! The thread that checks windows, and the hand-over to it.

use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use pairmask_core::mask::MaskShape;
use pairmask_core::objects::{ObjectForm, Objects};
use pairmask_wire::{AuditCounts, ReplyFields};

use super::check::{Outcome, check};
use super::rate::AuditRate;
use super::window::{Reach, Span2, Window};
use crate::scene::Random;

/// Windows in circulation: one being checked while the next is filled.
const WINDOWS: usize = 2;

/// The lowest priority of the system: the auditor runs when no other thread wants the core.
const NICE: i32 = 19;

/// Draws frames, copies windows of them and has them checked. Without a rate it does nothing.
pub struct Auditor {
    running: Option<Running>,
}

struct Running {
    one_in: u32,
    lots: Mutex<Lots>,
    /// Windows to be checked; `None` once the auditor stops.
    full: Option<SyncSender<Box<Window>>>,
    found: Arc<Found>,
    thread: Option<JoinHandle<()>>,
}

/// What frames are drawn with.
struct Lots {
    random: Random,
    /// Windows that are free.
    free: Receiver<Box<Window>>,
    skipped: u64,
}

/// The counts of the thread.
#[derive(Default)]
struct Found {
    frames: AtomicU64,
    pairs: AtomicU64,
    missed: AtomicU64,
    extra: AtomicU64,
}

impl Auditor {
    /// Starts the thread, if there is a rate.
    ///
    /// # Errors
    /// The system's error, where it starts no thread.
    pub fn start(rate: AuditRate) -> io::Result<Self> {
        let AuditRate::OneIn(one_in) = rate else { return Ok(Self { running: None }) };
        let (full, to_check) = sync_channel::<Box<Window>>(WINDOWS);
        let (back, free) = sync_channel(WINDOWS);
        for _ in 0..WINDOWS {
            // The channel has room for all windows.
            let _ = back.try_send(Box::default());
        }
        let found = Arc::new(Found::default());
        let told = Arc::clone(&found);
        let thread = std::thread::Builder::new()
            .name("auditor".into())
            .spawn(move || check_all(&to_check, &back, &told))?;
        // Each process has its own seed, and draws are random: frames in a rhythm are drawn evenly
        // too.
        let random = Random::new(u64::from(std::process::id()));
        Ok(Self {
            running: Some(Running {
                one_in: one_in.get(),
                lots: Mutex::new(Lots { random, free, skipped: 0 }),
                full: Some(full),
                found,
                thread: Some(thread),
            }),
        })
    }

    /// Draws whether the frame is checked. If it is, copies the part of the mask that may be
    /// overwritten once the reply is sent. Give the window to [`Auditor::submit`] afterwards.
    pub fn draw(
        &self,
        fields: &ReplyFields,
        form: ObjectForm,
        shape: &MaskShape,
        reply: &[u32],
    ) -> Option<Box<Window>> {
        let running = self.running.as_ref()?;
        let n = fields.box_count.get();
        let (mut window, span) = {
            let mut lots = running.lots.lock().unwrap_or_else(PoisonError::into_inner);
            if lots.random.below(u64::from(running.one_in)) != 0 || !Window::holds(shape) {
                return None;
            }
            let Ok(window) = lots.free.try_recv() else {
                lots.skipped += 1;
                return None;
            };
            (window, Span2::draw(n, Reach::of(form), &mut lots.random))
        };
        window.take_mask(n, span, shape, reply);
        (window.client_token, window.frame) = (fields.client_token, fields.frame);
        Some(window)
    }

    /// Copies the objects of a window and has it checked.
    pub fn submit(&self, mut window: Box<Window>, objects: Objects<'_>) {
        let Some(full) = self.running.as_ref().and_then(|running| running.full.as_ref()) else {
            return;
        };
        window.take_objects(objects);
        // The channel has room for all windows; a thread that panicked receives none.
        let _ = full.try_send(window);
    }

    /// The auditor's counts.
    pub fn counts(&self) -> AuditCounts {
        let Some(running) = &self.running else { return AuditCounts::default() };
        let found = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        AuditCounts {
            one_in: u64::from(running.one_in),
            frames: found(&running.found.frames),
            skipped: running.lots.lock().unwrap_or_else(PoisonError::into_inner).skipped,
            pairs: found(&running.found.pairs),
            missed: found(&running.found.missed),
            extra: found(&running.found.extra),
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Without a sender the thread ends after its present window.
        self.full = None;
        if let Some(thread) = self.thread.take() {
            // The panic message of the thread was printed already.
            let _ = thread.join();
        }
    }
}

fn check_all(windows: &Receiver<Box<Window>>, back: &SyncSender<Box<Window>>, found: &Found) {
    if let Err(error) = rustix::process::setpriority_process(None, NICE) {
        log::warn!("the auditor keeps its priority: {error}");
    }
    while let Ok(window) = windows.recv() {
        let outcome = check(&window);
        note(&window, &outcome, found);
        // The channel has room. When the auditor stops, it has no receiver.
        let _ = back.try_send(window);
    }
}

fn note(window: &Window, outcome: &Outcome, found: &Found) {
    let Outcome { pairs, missed, extra, first } = *outcome;
    let before = found.missed.fetch_add(missed, Ordering::Relaxed)
        + found.extra.fetch_add(extra, Ordering::Relaxed);
    found.pairs.fetch_add(pairs, Ordering::Relaxed);
    // Counted last: a reader that sees this frame counted sees its results too.
    found.frames.fetch_add(1, Ordering::Relaxed);
    if let Some(pair) = first
        && before == 0
    {
        // Logged once: a broken engine would fill the log. The counts go on.
        let Window { client_token, frame, .. } = window;
        log::error!(
            "audit: frame {frame} of client {client_token:016x} has {missed} missed and {extra} \
             extra pairs, the first {pair:?}: please report this"
        );
    }
}
