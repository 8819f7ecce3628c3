//! The thread that checks windows, and the hand-over to it.

use std::collections::BTreeMap;
use std::io;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use pairmask_core::mask::MaskShape;
use pairmask_core::objects::Objects;
use pairmask_core::scene::QueryFilterData;
use pairmask_core::{BoxCount, ObjectForm};
use pairmask_wire::{AuditCounts, ReplyFields, SentRules};

use super::check::{Outcome, check};
use super::scene::{SceneAudit, SceneNote};
use super::window::{Reach, Span2, Window};
use super::{AuditRate, NotedName};
use crate::locked;
use crate::scene::Random;

/// Windows in circulation: one being checked while the next is filled.
const WINDOWS: usize = 2;

/// Notes of scenes that wait: a scene that is edited faster than it is followed is given up.
const NOTES: usize = 64;

/// The lowest priority of the system: the auditor runs when no other thread needs the core.
const NICE: i32 = 19;

/// Draws frames, copies windows of them and has them checked. Without a rate it does nothing.
pub struct Auditor {
    running: Option<Running>,
}

struct Running {
    one_in: u32,
    lots: Mutex<Lots>,
    /// What is to be checked; `None` once the auditor stops.
    full: Option<SyncSender<Work>>,
    found: Arc<Found>,
    thread: Option<JoinHandle<()>>,
}

enum Work {
    Window(Box<Window>),
    Edit(AuditedScene, Box<SceneNote>),
}

#[derive(Debug)]
struct SceneToken {
    number: u64,
    most_boxes: u32,
    /// Whether an edit of it was skipped, so that it cannot be followed any more.
    is_lost: AtomicBool,
}

/// A scene that is audited, until all but the auditor have dropped it.
#[derive(Clone, Debug)]
pub struct AuditedScene(Arc<SceneToken>);

impl AuditedScene {
    fn is_lost(&self) -> bool {
        self.0.is_lost.load(Ordering::Relaxed)
    }

    fn lose(&self) {
        self.0.is_lost.store(true, Ordering::Relaxed);
    }
}

/// A frame, or a query of a scene, whose answer may be drawn.
pub struct AuditedFrame<'a> {
    pub form: ObjectForm,
    /// Objects of the first set, where it is of two; the queries of a scene.
    pub first_set: Option<BoxCount>,
    /// The scene of a query: each of its answers is drawn.
    pub scene: Option<&'a AuditedScene>,
    pub shape: &'a MaskShape,
    pub reply: &'a [u32],
}

struct Lots {
    random: Random,
    free: Receiver<Box<Window>>,
    scenes: u64,
}

struct Found {
    counts: Mutex<AuditCounts>,
    /// Edits of scenes that wait to be followed.
    edits: AtomicUsize,
}

impl Running {
    /// Has something checked, where the channel has room: as it has for all windows.
    fn send(&self, work: Work) -> bool {
        self.full.as_ref().is_some_and(|full| full.try_send(work).is_ok())
    }
}

impl Auditor {
    pub fn start(rate: AuditRate) -> io::Result<Self> {
        let AuditRate::OneIn(one_in) = rate else { return Ok(Self { running: None }) };
        let (full, to_check) = sync_channel(WINDOWS + NOTES);
        let (back, free) = sync_channel(WINDOWS);
        for _ in 0..WINDOWS {
            // The channel has room for all windows.
            let _ = back.try_send(Box::default());
        }
        let counts = AuditCounts { one_in: one_in.get().into(), ..AuditCounts::default() };
        let found = Arc::new(Found { counts: Mutex::new(counts), edits: AtomicUsize::new(0) });
        let reported = Arc::clone(&found);
        let thread = std::thread::Builder::new()
            .name("auditor".into())
            .spawn(move || check_all(&to_check, &back, &reported))?;
        // Each process has its own seed, and draws are random: frames in a pace are drawn evenly
        // too.
        let random = Random::new(u64::from(std::process::id()));
        Ok(Self {
            running: Some(Running {
                one_in: one_in.get(),
                lots: Mutex::new(Lots { random, free, scenes: 0 }),
                full: Some(full),
                found,
                thread: Some(thread),
            }),
        })
    }

    /// If the frame is drawn, copies what of its mask may be overwritten once it is sent, where a window is free: for
    /// [`Self::submit`].
    pub fn draw(&self, fields: &ReplyFields, frame: &AuditedFrame<'_>) -> Option<Box<Window>> {
        let running = self.running.as_ref()?;
        let mut lots = locked(&running.lots);
        let is_drawn = match frame.scene {
            Some(scene) => !scene.is_lost(),
            None => lots.random.below(running.one_in.into()) == 0,
        };
        if !is_drawn || !Window::holds(frame.shape) {
            return None;
        }
        let Ok(mut window) = lots.free.try_recv() else {
            locked(&running.found.counts).skipped += 1;
            return None;
        };
        let (n, first) = (fields.box_count.get(), frame.first_set);
        let is_ordered = matches!(frame.shape, MaskShape::Sparse { order: Some(_), .. });
        let rows = first.filter(|_| !is_ordered);
        let span = Span2::draw(rows, n, Reach::of(frame.form), &mut lots.random);
        drop(lots);
        window.first_set = first;
        window.scene = frame.scene.cloned();
        window.take_mask(n, span, frame.shape, frame.reply);
        (window.client_token, window.frame) = (fields.client_token, fields.frame);
        Some(window)
    }

    /// Copies the objects of a frame, or the queries of a scene with their filter data, and has the window checked.
    pub fn submit(
        &self,
        mut window: Box<Window>,
        objects: Objects<'_>,
        rules: Option<Arc<SentRules>>,
        filter_data: &QueryFilterData<'_>,
    ) {
        let Some(running) = &self.running else { return };
        window.take_objects(objects);
        window.rules = rules;
        window.filter_data = (0..objects.len() as u32).map(|query| filter_data.of(query)).collect();
        running.send(Work::Window(window));
    }

    pub fn draw_scene(&self, most_boxes: u32) -> Option<AuditedScene> {
        let running = self.running.as_ref()?;
        let mut lots = locked(&running.lots);
        if lots.random.below(u64::from(running.one_in)) != 0 {
            return None;
        }
        lots.scenes += 1;
        let (number, is_lost) = (lots.scenes, AtomicBool::new(false));
        Some(AuditedScene(Arc::new(SceneToken { number, most_boxes, is_lost })))
    }

    /// Has an edit of an audited scene followed. `note` is called where that can be.
    pub fn follow(&self, scene: &AuditedScene, note: impl FnOnce() -> Option<SceneNote>) {
        let Some(running) = self.running.as_ref().filter(|_| !scene.is_lost()) else { return };
        // The channel keeps room for all windows.
        let waiting = &running.found.edits;
        let has_room = waiting.fetch_add(1, Ordering::Relaxed) < NOTES;
        let send = |note| running.send(Work::Edit(scene.clone(), Box::new(note)));
        let sent = || note().is_some_and(send);
        if !(has_room && sent()) {
            waiting.fetch_sub(1, Ordering::Relaxed);
            scene.lose();
            locked(&running.found.counts).skipped += 1;
        }
    }

    pub fn counts(&self) -> AuditCounts {
        self.running.as_ref().map(|running| *locked(&running.found.counts)).unwrap_or_default()
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

fn check_all(work: &Receiver<Work>, back: &SyncSender<Box<Window>>, found: &Found) {
    if let Err(error) = rustix::process::setpriority_process(None, NICE) {
        log::warn!("the auditor keeps its priority: {error}");
    }
    let mut scenes: BTreeMap<u64, (AuditedScene, SceneAudit)> = BTreeMap::new();
    while let Ok(work) = work.recv() {
        match work {
            Work::Window(mut window) => {
                let outcome = match window.scene.take() {
                    None => Some(check(&window, |_, _| true)),
                    // One whose edits are not followed any more has other boxes.
                    Some(scene) if scene.is_lost() => None,
                    Some(scene) => {
                        scenes.get(&scene.0.number).map(|(_, scene)| scene.check_query(&mut window))
                    }
                };
                if let Some(outcome) = outcome {
                    note(window.name(), &outcome, found);
                }
                window.rules = None;
                // The channel has room. When the auditor stops, it has no receiver.
                let _ = back.try_send(window);
            }
            Work::Edit(scene, edit) => {
                found.edits.fetch_sub(1, Ordering::Relaxed);
                // One of them is the auditor's own: the scene has ended.
                scenes.retain(|_, (kept, _)| Arc::strong_count(&kept.0) > 1);
                let SceneToken { number, most_boxes, .. } = *scene.0;
                let begin = || (scene.clone(), SceneAudit::new(most_boxes, number));
                let (_, audit) = scenes.entry(number).or_insert_with(begin);
                let name = edit.name;
                match audit.follow(*edit) {
                    Some(outcome) => note(name, &outcome, found),
                    None => scene.lose(),
                }
            }
        }
    }
}

fn note(name: NotedName, outcome: &Outcome, found: &Found) {
    let Outcome { pairs, missed, extra, first } = *outcome;
    let mut counts = locked(&found.counts);
    let before = counts.missed + counts.extra;
    counts.missed += missed;
    counts.extra += extra;
    counts.pairs += pairs;
    counts.frames += 1;
    drop(counts);
    if let Some(pair) = first
        && before == 0
    {
        // Logged once: a broken engine would fill the log. The counts go on.
        log::error!(
            "audit: {name} has {missed} missed and {extra} extra pairs, the first {pair:?}: please \
             report this"
        );
    }
}
