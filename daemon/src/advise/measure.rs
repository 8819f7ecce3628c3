//! What a tick of a work takes: written, waited for, iterated over.

use std::hint::black_box;
use std::time::{Duration, Instant};

use pairmask::{
    ConnectError, Error, FrameOptions, PairMask, Pending, Report, Scene, SceneAnswer, SceneEdit,
    SceneOptions, Session,
};
use pairmask_core::cast::Shapes;
use pairmask_core::{Aabb, Precision};
use pairmask_wire::{EditScratch, Reject, Request};

use super::choose::Figures;
use super::hosts::Hosts;
use super::options::{Form, Way};
use super::workload::{Answer, Boxes, EditTick, Recorded, Work, Workload};
use crate::daemon_cpu::nanoseconds_a;
use crate::percentiles::Recorder;
use crate::precision::PrecisionChoice;
use crate::recording::{Asked, AskedFrame};

/// A tick of a shared scene ends when all writers have committed, and not by its deadline.
const TICK_DEADLINE: Duration = Duration::from_secs(10);
/// The first ticks of a turn find cold caches, sleeping threads and a daemon that still spins for another way's client: one
/// in so many is not counted.
const UNCOUNTED_SHARE: usize = 4;

#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    #[error("{way}: {source}")]
    Connect { way: String, source: ConnectError },
    #[error("{way}: {source}")]
    Session { way: String, source: Error },
    #[error("no way to serve it could be measured")]
    NoWay,
    #[error("{way}: a recorded request is not valid: {source}")]
    Invalid { way: String, source: Reject },
}

/// A program that does a work in one way.
pub struct Client<'a> {
    workload: &'a Workload,
    hosts: &'a Hosts,
    way: Way,
    /// Several of a shared scene, one for each writer.
    sessions: Vec<Session>,
    scenes: Vec<Scene>,
    precision: Precision,
    step: usize,
    scratch: EditScratch,
    /// Pairs of the tick before, sorted, where changes of them are asked for.
    known: Vec<[u32; 2]>,
    times: Recorder,
    /// What each step took, whenever it was done.
    repeats: Vec<Vec<u64>>,
    pairs: u64,
    cpu: Duration,
    ticks: u64,
    /// A tick of the last turn, on average.
    last_tick: Duration,
}

/// Why a tick failed, without the way.
enum Failed {
    Session(Error),
    Invalid(Reject),
}

impl From<Error> for Failed {
    fn from(error: Error) -> Self {
        Self::Session(error)
    }
}

impl<'a> Client<'a> {
    /// Connects, and sends what there is before the first tick. Others have scenes of other names.
    pub fn open(
        workload: &'a Workload,
        way: Way,
        hosts: &'a Hosts,
        name: &str,
    ) -> Result<Self, MeasureError> {
        let sessions = match &workload.work {
            Work::Boxes(boxes) => boxes.writers.len().max(1),
            _ => 1,
        };
        let sessions = (0..sessions).map(|_| hosts.connect(&way)).collect::<Result<_, _>>();
        let mut client = Self {
            workload,
            hosts,
            way,
            sessions: sessions
                .map_err(|source| MeasureError::Connect { way: way.to_string(), source })?,
            scenes: Vec::new(),
            precision: precision_of(workload, way.form),
            step: 0,
            scratch: EditScratch::default(),
            known: Vec::new(),
            times: Recorder::default(),
            repeats: vec![Vec::new(); workload.steps()],
            pairs: 0,
            cpu: Duration::ZERO,
            ticks: 0,
            last_tick: Duration::ZERO,
        };
        client.begin(name).map_err(|failed| client.named(failed))?;
        Ok(client)
    }

    /// Does some ticks. The first ones are not counted.
    pub fn turn(&mut self, ticks: usize) -> Result<(), MeasureError> {
        let (cpu, begun) = (self.hosts.cpu(self.way.host), Instant::now());
        for at in 0..ticks {
            let (took, pairs) = self.tick().map_err(|failed| self.named(failed))?;
            if at >= ticks / UNCOUNTED_SHARE {
                let (ns, steps) = (took.as_nanos() as u64, self.repeats.len());
                self.times.record(ns);
                self.repeats[self.step % steps].push(ns);
                self.pairs += pairs;
            }
        }
        self.cpu += self.hosts.cpu(self.way.host).saturating_sub(cpu);
        self.ticks += ticks as u64;
        self.last_tick = begun.elapsed() / ticks.max(1) as u32;
        Ok(())
    }

    /// Forgets what was measured: a new round.
    pub fn begin_round(&mut self) {
        self.times.clear();
        self.repeats.iter_mut().for_each(Vec::clear);
        (self.pairs, self.cpu, self.ticks) = (0, Duration::ZERO, 0);
    }

    pub fn figures(&self) -> Figures {
        let percentiles = self.times.percentiles();
        let ticks = self.times.count();
        Figures {
            ticks,
            usual_ns: usual(&self.repeats),
            p50_ns: percentiles.p50,
            p99_ns: percentiles.p99,
            cpu_ns: nanoseconds_a(self.cpu, self.ticks),
            pairs: self.pairs / ticks.max(1),
        }
    }

    /// So many ticks take about so long.
    pub const fn ticks_in(&self, time: Duration) -> usize {
        (time.as_nanos() / if self.last_tick.is_zero() { 1 } else { self.last_tick.as_nanos() })
            as usize
    }

    pub const fn way(&self) -> Way {
        self.way
    }

    fn named(&self, failed: Failed) -> MeasureError {
        let way = self.way.to_string();
        match failed {
            Failed::Session(source) => MeasureError::Session { way, source },
            Failed::Invalid(source) => MeasureError::Invalid { way, source },
        }
    }

    fn begin(&mut self, name: &str) -> Result<(), Failed> {
        let Form::Scene(margin) = self.way.form else { return Ok(()) };
        let mut options = SceneOptions::default();
        if let Some(of) = margin {
            options = options.with_margin(of.margin).with_near_pairs(of.near);
        }
        let Work::Boxes(boxes) = &self.workload.work else { return Ok(()) };
        if boxes.writers.is_empty() {
            self.scenes.push(self.sessions[0].scene(options.clone())?);
        }
        let options = options.with_shared(name).with_tick_deadline(TICK_DEADLINE);
        for (session, writer) in self.sessions.iter_mut().zip(&boxes.writers) {
            let mut scene = session.scene(options.clone())?;
            scene.lease(writer.clone())?;
            self.scenes.push(scene);
        }
        let (state, _) = boxes.step(0);
        let all: Vec<u32> = (0..state.len() as u32).collect();
        edit_all(&mut self.scenes, boxes, state, &all, Report::Nothing)?;
        Ok(())
    }

    /// What the next tick takes, and the pairs that were iterated over.
    fn tick(&mut self) -> Result<(Duration, u64), Failed> {
        match (&self.workload.work, self.way.form) {
            (Work::Boxes(boxes), Form::Frame(_)) => {
                self.step += 1;
                let (state, _) = boxes.step(self.step);
                let begun = Instant::now();
                let mask =
                    frame(&mut self.sessions[0], state, self.precision, &FrameOptions::default())?;
                let pairs = match boxes.answer {
                    Answer::Pairs => look_at(&mask),
                    Answer::Changes => compare(&mask, &mut self.known),
                };
                Ok((begun.elapsed(), pairs))
            }
            (Work::Boxes(boxes), Form::Scene(_)) => {
                self.step += 1;
                let (state, moved) = boxes.step(self.step);
                let report = match boxes.answer {
                    Answer::Pairs => Report::All,
                    Answer::Changes => Report::Changes,
                };
                let begun = Instant::now();
                let pairs = edit_all(&mut self.scenes, boxes, state, moved, report)?;
                Ok((begun.elapsed(), pairs))
            }
            (Work::Frames(frames), _) => {
                self.step += 1;
                let asked = &frames[self.step % frames.len()];
                self.asked_frame(asked)
            }
            (Work::Edits(ticks), _) => self.edit_tick(ticks),
        }
    }

    fn asked_frame(&mut self, asked: &AskedFrame) -> Result<(Duration, u64), Failed> {
        let options = FrameOptions { filters: asked.filters.clone(), split_at: asked.split_at };
        let session = &mut self.sessions[0];
        let begun = Instant::now();
        let mask = match &asked.objects {
            Asked::Boxes(boxes) => frame(session, boxes, self.precision, &options)?,
            Asked::Spheres(spheres) => {
                let mut frame = session.sphere_frame(spheres.len())?;
                frame.spheres_mut().copy_from_slice(spheres);
                frame.submit()?.wait()?
            }
        };
        let pairs = look_at(&mask);
        Ok((begun.elapsed(), pairs))
    }

    /// An edit as it was recorded, and what is asked behind it. The scene begins anew with the first one, which is not
    /// measured.
    fn edit_tick(&mut self, ticks: &[EditTick]) -> Result<(Duration, u64), Failed> {
        let Self { sessions, scenes, scratch, step, .. } = self;
        let at = *step % ticks.len();
        if at == 0 {
            scenes.clear();
            scenes.push(sessions[0].scene(SceneOptions::default())?);
        }
        let Some(scene) = scenes.first_mut() else { return Ok((Duration::ZERO, 0)) };
        let mut done = edit_as_recorded(scene, scratch, &ticks[at])?;
        *step += 1;
        if at == 0 && ticks.len() > 1 {
            done = edit_as_recorded(scene, scratch, &ticks[1])?;
            *step += 1;
        }
        Ok(done)
    }
}

/// The mean over the steps that were done, of each the median. A step that another program interrupted counts as its
/// other repetitions; one in which a margin is left counts as much as the many in which none is.
fn usual(repeats: &[Vec<u64>]) -> u64 {
    let done = repeats.iter().filter(|ns| !ns.is_empty());
    let medians = done.map(|ns| {
        let mut ns = ns.clone();
        let middle = (ns.len() - 1) / 2;
        *ns.select_nth_unstable(middle).1
    });
    let (sum, count) = medians.fold((0, 0), |(sum, count), ns| (sum + ns, count + 1));
    sum / count.max(1)
}

/// The precision of frames, with bounds of all boxes of the work, as a program has those of its world.
fn precision_of(workload: &Workload, form: Form) -> Precision {
    let Form::Frame(choice) = form else { return Precision::Exact };
    if choice == PrecisionChoice::Exact {
        return Precision::Exact;
    }
    match &workload.work {
        Work::Boxes(boxes) => choice.precision(&boxes.all()),
        Work::Frames(frames) => {
            let boxes = frames.iter().filter_map(|frame| match &frame.objects {
                Asked::Boxes(boxes) => Some(boxes),
                Asked::Spheres(_) => None,
            });
            choice.precision(&boxes.flatten().copied().collect::<Vec<_>>())
        }
        Work::Edits(_) => Precision::Exact,
    }
}

fn frame(
    session: &mut Session,
    boxes: &[Aabb],
    precision: Precision,
    options: &FrameOptions,
) -> Result<PairMask, Error> {
    if precision == Precision::Exact {
        let mut frame = session.frame(boxes.len())?;
        frame.write(boxes)?;
        return frame.submit_with(options)?.wait();
    }
    let mut frame = session.narrow_frame(boxes.len(), precision)?;
    frame.write(boxes)?;
    frame.submit_with(options)?.wait()
}

/// Edits the scenes of all writers, which are answered together, and iterates over what they report.
fn edit_all(
    scenes: &mut [Scene],
    boxes: &Boxes,
    state: &[Aabb],
    moved: &[u32],
    report: Report,
) -> Result<u64, Error> {
    let mut pending: Vec<Pending<SceneAnswer<'_>>> = Vec::with_capacity(scenes.len());
    for (at, scene) in scenes.iter_mut().enumerate() {
        let own = match boxes.writers.get(at) {
            Some(range) => {
                let [first, end] =
                    [range.start, range.end].map(|end| moved.partition_point(|i| *i < end));
                &moved[first..end]
            }
            None => moved,
        };
        let edit = scene.edit().set_with(own, |index| state[index as usize]);
        pending.push(edit.submit(report)?);
    }
    pending.into_iter().map(|pending| Ok(look_at_answer(&pending.wait()?))).sum()
}

fn edit_as_recorded(
    scene: &mut Scene,
    scratch: &mut EditScratch,
    tick: &EditTick,
) -> Result<(Duration, u64), Failed> {
    let Request::EditScene(request) = &tick.edit.request else { return Ok((Duration::ZERO, 0)) };
    let steps = scratch.read(request, &tick.edit.pages).map_err(Failed::Invalid)?;
    let begun = Instant::now();
    let edit = steps.into_iter().fold(scene.edit(), SceneEdit::step);
    let mut pairs = look_at_answer(&edit.commit(request.report)?);
    for asked in &tick.asked {
        pairs += ask(scene, asked)?;
    }
    Ok((begun.elapsed(), pairs))
}

fn ask(scene: &mut Scene, asked: &Recorded) -> Result<u64, Failed> {
    let payload = || Failed::Invalid(Reject::Query("payload"));
    match &asked.request {
        Request::QueryScene(request) => {
            let (boxes, filter_data) = request.read(&asked.pages).ok_or_else(payload)?;
            let answer = scene.query_as(boxes, filter_data, request.encoding)?;
            let (mut count, mut indices) = (0, 0);
            answer.for_each_slice(|pairs| {
                count += pairs.len() as u64;
                indices = pairs.iter().fold(indices, |all, [a, b]| all ^ a ^ b);
            });
            black_box(indices);
            Ok(count)
        }
        Request::CastScene(request) => {
            let (shapes, filter_data) = request.read(&asked.pages).ok_or_else(payload)?;
            let answer = match shapes {
                Shapes::Rays(rays) => scene.cast_filtered(rays, request.hits, filter_data)?,
                Shapes::Spheres(spheres) => {
                    scene.cast_filtered(spheres, request.hits, filter_data)?
                }
            };
            black_box(answer.hits());
            Ok(answer.hits().len() as u64)
        }
        _ => Ok(0),
    }
}

/// Iterates over all pairs, and counts them.
fn look_at(mask: &PairMask) -> u64 {
    let (mut count, mut indices) = (0, 0);
    mask.for_each_slice(|pairs| {
        count += pairs.len() as u64;
        indices = pairs.iter().fold(indices, |all, [a, b]| all ^ a ^ b);
    });
    // The compiler keeps the iteration for it.
    black_box(indices);
    count
}

/// The pairs that began and ended, as a client finds them that gets all pairs: how many.
fn compare(mask: &PairMask, known: &mut Vec<[u32; 2]>) -> u64 {
    let mut now = Vec::with_capacity(known.len());
    mask.for_each_slice(|pairs| now.extend_from_slice(pairs));
    now.sort_unstable();
    let (mut stayed, mut before) = (0, known.iter().peekable());
    for pair in &now {
        while before.next_if(|other| *other < pair).is_some() {}
        stayed += u64::from(before.next_if_eq(&pair).is_some());
    }
    let changes = (known.len() + now.len()) as u64 - 2 * stayed;
    *known = now;
    changes
}

fn look_at_answer(answer: &SceneAnswer<'_>) -> u64 {
    let (mut count, mut indices) = (0, 0);
    for list in [answer.begun(), answer.pairs()] {
        list.for_each_slice(|pairs| {
            count += pairs.len() as u64;
            indices = pairs.iter().fold(indices, |all, [a, b]| all ^ a ^ b);
        });
    }
    for ended in answer.ended() {
        count += 1;
        indices ^= ended.pair[0];
    }
    black_box(indices);
    count
}

#[cfg(test)]
mod tests {
    use super::super::options::{Host, Means, ways};
    use super::*;
    use crate::scene::{Scene as Seeded, SceneName};

    /// Pairs in so many ticks, by way.
    fn counted(workload: &Workload, ticks: usize) -> Vec<(Way, u64)> {
        let hosts = Hosts::of_process();
        let all = ways(workload, Means { cores: 2, has_gpu: false });
        let here = all.into_iter().filter(|way| way.host == Host::InProcess);
        let count = |way: Way| {
            let mut client = Client::open(workload, way, &hosts, "none").expect("in process");
            client.turn(UNCOUNTED_SHARE).expect("ticks");
            client.begin_round();
            // In turns that are too short to leave ticks out.
            (0..ticks).for_each(|_| client.turn(1).expect("a tick"));
            (way, client.pairs)
        };
        here.map(count).collect()
    }

    #[test]
    fn a_usual_tick_is_none_that_was_interrupted() {
        assert_eq!(usual(&[]), 0);
        assert_eq!(usual(&[vec![], vec![7]]), 7);
        // A cheap step, and one in which a request is made.
        let repeats = [vec![10, 9_000, 12], vec![110, 100, 8_000, 112]];
        assert_eq!(usual(&repeats), 61);
    }

    #[test]
    fn every_way_does_the_same_work() {
        let boxes = Seeded::new(SceneName::Pile, 300, 1).boxes().to_vec();
        for answer in [Answer::Pairs, Answer::Changes] {
            let workload = Workload::of_boxes(boxes.clone(), 0.3, answer).expect("boxes");
            let all = counted(&workload, 40);
            assert!(all.len() >= 8, "frames and scenes, margins and none: {all:?}");
            let exact = all.iter().find(|(way, _)| !way.is_near()).expect("a way").1;
            assert!(exact > 40, "{exact}");
            for (way, pairs) in all {
                match (way.is_near(), answer) {
                    (false, _) => assert_eq!(pairs, exact, "{way}"),
                    (true, Answer::Pairs) => assert!(pairs >= exact, "{way}: {pairs} of {exact}"),
                    (true, Answer::Changes) => {}
                }
            }
        }
    }
}
