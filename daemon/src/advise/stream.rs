//! The requests of a recording that are one work: the frames of a session, the edits of a scene and what it is asked, or
//! the commits of all members of a shared scene. Of several, the one with the most bytes counts.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::io::Read;
use std::ops::Range;

use pairmask_core::scene::{Report, Sets, Step};
use pairmask_core::{Aabb, BoxForm, ObjectForm};
use pairmask_wire::{
    EditScratch, PAGE_BYTES, Request, SceneId, SceneName, SceneRequest, page_count,
};

use super::workload::{Answer, Boxes, EditTick, Recorded, Work, Workload, WorkloadError};
use crate::recording::{
    Asked, AskedFrame, Event, FrameReader, ReadError, Record, Recording, pages_of,
};

/// Payloads that are looked at: a recording of hours has no other ticks than one of minutes.
const MOST_BYTES: usize = 512 << 20;
/// Indices of a scene are below this, for the memory of all its ticks.
const MOST_INDICES: u64 = 1 << 22;
/// Memory of the boxes of all ticks of a scene: what follows has no other ticks.
const MOST_STATE_BYTES: usize = 1 << 30;
/// Ticks that are measured as they were recorded.
const MOST_EDITS: usize = 240;
/// A stream that has more than this share of all bytes is the program's work.
const NEARLY_ALL: f64 = 0.95;

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Key {
    Frames(u64),
    Scene(u64, u32),
    Shared(String),
}

#[derive(Default)]
struct Stream {
    requests: Vec<(u64, Recorded)>,
    bytes: usize,
}

#[derive(Default)]
struct Streams {
    found: BTreeMap<Key, Stream>,
    /// The names of shared scenes by their members.
    members: HashMap<(u64, SceneId), String>,
    bytes: usize,
}

pub(super) fn workload(recording: &mut Recording<impl Read>) -> Result<Workload, WorkloadError> {
    let mut streams = Streams::default();
    while streams.bytes < MOST_BYTES {
        match recording.next_block() {
            Ok(Some(records)) => records.iter().try_for_each(|record| streams.add(record))?,
            // What comes before is whole.
            Ok(None) | Err(ReadError::Cut { .. } | ReadError::Damaged { .. }) => break,
            Err(error) => return Err(error.into()),
        }
    }
    let (count, all) = (streams.found.len(), streams.bytes);
    let largest = streams.found.into_iter().max_by_key(|(_, stream)| stream.bytes);
    let (key, stream) = largest.ok_or(WorkloadError::Empty)?;
    let share = stream.bytes as f64 / all.max(1) as f64;
    let mut workload = match key {
        Key::Frames(_) => of_frames(&stream),
        Key::Scene(..) => of_scene(stream),
        Key::Shared(_) => of_shared(&stream),
    }?;
    if share < NEARLY_ALL {
        let percent = 100.0 * share;
        workload.notes.push(format!(
            "It holds {count} works; this is the one with {percent:.0} % of what is sent."
        ));
    }
    Ok(workload)
}

impl Streams {
    fn add(&mut self, record: &Record) -> Result<(), WorkloadError> {
        let Event::Request { session, number, header, payload } = &record.event else {
            return Ok(());
        };
        let payload_bytes = page_count(payload.len() as u64) * PAGE_BYTES as u64;
        let request = Request::parse(header, payload_bytes)
            .map_err(|source| WorkloadError::Invalid { number: *number, source })?;
        let pages = pages_of(payload);
        let of_scene = |scene: SceneId| match self.members.get(&(*session, scene)) {
            Some(name) => Key::Shared(name.clone()),
            None => Key::Scene(*session, scene.0),
        };
        let key = match &request {
            Request::Cull(_) => Key::Frames(*session),
            Request::EditScene(edit) | Request::CommitShared(edit) => of_scene(edit.scene),
            Request::QueryScene(query) => of_scene(query.scene),
            Request::CastScene(cast) => of_scene(cast.scene),
            Request::JoinShared(join) => {
                if let Some(name) = SceneName::read(join, &pages) {
                    self.members.insert((*session, join.scene), name.to_string());
                }
                return Ok(());
            }
            _ => return Ok(()),
        };
        let bytes = payload.len() + size_of_val(&**header);
        self.bytes += bytes;
        let stream = self.found.entry(key).or_default();
        stream.bytes += bytes;
        stream.requests.push((*session, Recorded { request, pages }));
        Ok(())
    }
}

fn invalid(source: pairmask_wire::Reject) -> WorkloadError {
    WorkloadError::Invalid { number: 0, source }
}

fn of_frames(stream: &Stream) -> Result<Workload, WorkloadError> {
    let mut reader = FrameReader::default();
    let mut frames: Vec<AskedFrame> = Vec::with_capacity(stream.requests.len());
    for (_, recorded) in &stream.requests {
        if let Request::Cull(request) = &recorded.request {
            frames.push(reader.read(request, &recorded.pages).map_err(invalid)?);
        }
    }
    let mut notes = Vec::new();
    let exact = [ObjectForm::Boxes(BoxForm::F32), ObjectForm::Spheres];
    let accepts_near = frames.iter().any(|frame| !exact.contains(&frame.form));
    if accepts_near {
        notes.push("It sends narrow boxes: near pairs do no harm.".to_owned());
    }
    let has = |what: fn(&AskedFrame) -> bool| frames.iter().any(what);
    let only = [
        (has(|frame| matches!(frame.objects, Asked::Spheres(_))), "It sends spheres"),
        (has(|frame| frame.split_at.is_some()), "It asks for pairs of two sets"),
        (has(|frame| frame.filters.is_some()), "It has filters"),
    ];
    let only: Vec<&str> = only.iter().filter(|(has, _)| *has).map(|(_, what)| *what).collect();
    if !only.is_empty() {
        notes.extend(
            only.iter().map(|what| format!("{what}, as frames have them: frames alone serve it.")),
        );
        return Ok(Workload { work: Work::Frames(frames), accepts_near, notes });
    }
    let states = frames.into_iter().map(|frame| match frame.objects {
        Asked::Boxes(boxes) => boxes,
        Asked::Spheres(_) => Vec::new(),
    });
    let work = Work::Boxes(Boxes::new(states.collect(), Answer::Pairs, Vec::new()));
    Ok(Workload { work, accepts_near, notes })
}

/// What edits do that frames of boxes cannot say.
#[derive(Default)]
struct Beyond(BTreeSet<&'static str>);

impl Beyond {
    fn note(&mut self, request: &SceneRequest, steps: &[Step<'_>]) {
        if request.reported.is_some() {
            self.0.insert("It goes back to snapshots");
        }
        self.0.extend(steps.iter().filter_map(|step| match step {
            Step::Set(_) | Step::Remove(_) | Step::Enable(..) => None,
            Step::Static(..) => Some("It has static boxes"),
            Step::UserData(_) => Some("It gives boxes user data"),
            _ => Some("It has filters that scenes keep"),
        }));
    }
}

/// Boxes as edits leave them.
#[derive(Default)]
struct State {
    boxes: Vec<Aabb>,
    is_disabled: Vec<bool>,
}

impl State {
    /// Applies an edit whose indices are not too large for the memory of a state.
    fn apply(&mut self, steps: &[Step<'_>]) -> Result<(), WorkloadError> {
        for step in steps {
            let last = match step {
                Step::Set(Sets { indices, .. })
                | Step::Remove(indices)
                | Step::Enable(indices, _) => indices.last().unwrap_or(0),
                _ => 0,
            };
            if last >= MOST_INDICES {
                return Err(WorkloadError::TooLarge { index: last, most: MOST_INDICES });
            }
            match step {
                Step::Set(sets) => sets.indices.for_each(|n, index| {
                    let at = self.at(index);
                    self.boxes[at] = sets.boxes[n];
                }),
                Step::Remove(indices) => indices.for_each(|_, index| {
                    let at = self.at(index);
                    (self.boxes[at], self.is_disabled[at]) = (Aabb::EMPTY, false);
                }),
                Step::Enable(indices, on) => indices.for_each(|_, index| {
                    let at = self.at(index);
                    self.is_disabled[at] = !on;
                }),
                _ => {}
            }
        }
        Ok(())
    }

    fn at(&mut self, index: u32) -> usize {
        let at = index as usize;
        if at >= self.boxes.len() {
            self.boxes.resize(at + 1, Aabb::EMPTY);
            self.is_disabled.resize(at + 1, false);
        }
        at
    }

    fn enabled(&self) -> Vec<Aabb> {
        let all = self.boxes.iter().zip(&self.is_disabled);
        all.map(|(b, is_disabled)| if *is_disabled { Aabb::EMPTY } else { *b }).collect()
    }

    fn len(&self) -> usize {
        self.boxes.iter().filter(|b| **b != Aabb::EMPTY).count()
    }
}

fn of_scene(stream: Stream) -> Result<Workload, WorkloadError> {
    let (mut state, mut states, mut ticks) = (State::default(), Vec::new(), Vec::<EditTick>::new());
    let (mut scratch, mut beyond, mut reports) =
        (EditScratch::default(), Beyond::default(), vec![]);
    let mut states_bytes = 0;
    for (_, recorded) in stream.requests {
        match &recorded.request {
            Request::EditScene(request) => {
                let steps = scratch.read(request, &recorded.pages).map_err(invalid)?;
                if request.base == 0 {
                    // It is sent again, as it is now.
                    state = State::default();
                }
                beyond.note(request, &steps);
                state.apply(&steps)?;
                reports.push(request.report);
                states_bytes += state.boxes.len() * size_of::<Aabb>();
                if states_bytes > MOST_STATE_BYTES {
                    break;
                }
                states.push(state.enabled());
                ticks.push(EditTick { edit: recorded, asked: Vec::new(), boxes: state.len() });
            }
            request => {
                let is_query = matches!(request, Request::QueryScene(_));
                beyond.0.insert(if is_query {
                    "It asks queries"
                } else {
                    "It casts rays or spheres"
                });
                if let Some(tick) = ticks.last_mut() {
                    tick.asked.push(recorded);
                }
            }
        }
    }
    if ticks.is_empty() {
        return Err(WorkloadError::Empty);
    }
    let answer = answer_of(&reports);
    if beyond.0.is_empty() {
        let notes = asks(answer).into_iter().collect();
        let work = Work::Boxes(Boxes::new(states, answer, Vec::new()));
        return Ok(Workload { work, accepts_near: false, notes });
    }
    ticks.truncate(MOST_EDITS);
    let what = beyond.0.into_iter().collect::<Vec<_>>().join(". ");
    let notes = vec![format!("{what}: a scene alone serves it.")];
    Ok(Workload { work: Work::Edits(ticks), accepts_near: false, notes })
}

fn answer_of(reports: &[Report]) -> Answer {
    let is_asked = |report: Report| reports.contains(&report);
    let pairs = is_asked(Report::All) || is_asked(Report::Moved);
    if pairs && !is_asked(Report::Changes) { Answer::Pairs } else { Answer::Changes }
}

fn asks(answer: Answer) -> Option<String> {
    let what = "It asks which pairs began and ended: after a frame it compares them itself.";
    (answer == Answer::Changes).then(|| what.to_owned())
}

fn of_shared(stream: &Stream) -> Result<Workload, WorkloadError> {
    let (mut state, mut states) = (State::default(), Vec::new());
    let (mut scratch, mut reports) = (EditScratch::default(), Vec::new());
    let (mut committed, mut writers) = (BTreeSet::new(), BTreeMap::<u64, Range<u32>>::new());
    let (mut is_approximate, mut states_bytes) = (false, 0);
    for (session, recorded) in &stream.requests {
        let Request::CommitShared(request) = &recorded.request else {
            is_approximate = true;
            continue;
        };
        // A session commits once a tick.
        if !committed.insert(*session) {
            states_bytes += state.boxes.len() * size_of::<Aabb>();
            if states_bytes > MOST_STATE_BYTES {
                break;
            }
            states.push(state.enabled());
            committed = BTreeSet::from([*session]);
        }
        let steps = scratch.read(request, &recorded.pages).map_err(invalid)?;
        for step in &steps {
            match step {
                Step::Set(sets) => sets.indices.for_each(|_, i| widen(&mut writers, *session, i)),
                Step::Remove(_) | Step::Enable(..) => {}
                _ => is_approximate = true,
            }
        }
        state.apply(&steps)?;
        reports.push(request.report);
    }
    states.push(state.enabled());
    let mut writers: Vec<Range<u32>> = writers.into_values().collect();
    writers.sort_by_key(|range| range.start);
    if let Some(two) = writers.windows(2).find(|two| two[0].end > two[1].start) {
        return Err(WorkloadError::Writers(two[0].clone(), two[1].clone()));
    }
    if writers.is_empty() {
        return Err(WorkloadError::Empty);
    }
    let count = writers.len();
    let mut notes =
        vec![format!("{count} processes write one scene: a shared scene alone serves it.")];
    if is_approximate {
        notes
            .push("Its boxes are measured, without its filters, user data and queries.".to_owned());
    }
    let work = Work::Boxes(Boxes::new(states, answer_of(&reports), writers));
    Ok(Workload { work, accepts_near: false, notes })
}

fn widen(writers: &mut BTreeMap<u64, Range<u32>>, session: u64, index: u32) {
    let range = writers.entry(session).or_insert(index..index.saturating_add(1));
    *range = range.start.min(index)..range.end.max(index.saturating_add(1));
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::BufReader;

    use pairmask_core::EngineChoice;
    use pairmask_core::scene::Edit;
    use pairmask_wire::{EditLayout, RequestHeader};

    use super::*;

    fn recorded(name: &str) -> Workload {
        let file = format!("{}/../tests/recordings/{name}.pmrec", env!("CARGO_MANIFEST_DIR"));
        let file = BufReader::new(File::open(file).expect("a recording"));
        workload(&mut Recording::open(file).expect("a recording")).expect("a work")
    }

    #[test]
    fn each_recording_is_the_work_that_its_program_does() {
        let is_boxes = |name: &str, answer: Answer| {
            let found = recorded(name);
            let Work::Boxes(boxes) = &found.work else { panic!("{name}: {:?}", found.notes) };
            assert_eq!(boxes.answer, answer, "{name}");
            (boxes.writers.len(), found.accepts_near)
        };
        assert_eq!(is_boxes("bullet", Answer::Changes), (0, false));
        assert_eq!(is_boxes("crowd", Answer::Pairs), (0, true));
        assert_eq!(is_boxes("several-processes", Answer::Changes), (4, false));
        for (name, ticks, boxes) in
            [("bubbles", 30, 500), ("rl-batch", 30, 576), ("sensors", 40, 500)]
        {
            let found = recorded(name);
            assert!(matches!(found.work, Work::Frames(_)), "{name}");
            assert_eq!((found.ticks(), found.boxes()), (ticks, boxes), "{name}");
        }
        for (name, reason) in [
            ("falling-boxes", "static boxes"),
            ("city", "casts rays"),
            ("robot-arm", "asks queries"),
            ("rollback", "snapshots"),
        ] {
            let found = recorded(name);
            assert!(matches!(found.work, Work::Edits(_)), "{name}");
            assert!(found.notes[0].contains(reason), "{name}: {:?}", found.notes);
        }
    }

    /// A recorded edit that sets these indices.
    fn edit(indices: &[u32], base: u64) -> (u64, Recorded) {
        let boxes: Vec<Aabb> =
            indices.iter().map(|i| Aabb::new([*i as f32; 3], [1e9; 3])).collect();
        let steps = [Step::Set(Sets { indices: indices.into(), boxes: &boxes })];
        let layout = EditLayout::of(Edit { steps: &steps }).expect("a small edit");
        let [boxes, steps_at, indices] = layout.sections();
        let request = SceneRequest {
            scene: SceneId(1),
            base,
            revision: base + 1,
            is_acknowledged: false,
            is_lost: false,
            reported: None,
            report: Report::Changes,
            most_boxes: 1 << 29,
            engine: EngineChoice::Auto,
            threads: None,
            boxes,
            steps: steps_at,
            indices,
        };
        let mut pages = pages_of(&vec![0; layout.payload_bytes() as usize]);
        assert!(layout.write(Edit { steps: &steps }, &mut pages));
        let header = RequestHeader::edit_scene(1, 1, &request);
        let bytes = size_of_val(&pages[..]) as u64;
        (1, Recorded { request: Request::parse(&header, bytes).expect("valid"), pages })
    }

    #[test]
    fn edits_become_boxes_and_an_index_takes_no_more_memory_than_there_is() {
        let stream = |requests| of_scene(Stream { requests, bytes: 0 });
        // A scene that is sent again has no more of its boxes than that.
        let found =
            stream(vec![edit(&[0, 1, 5], 0), edit(&[1], 1), edit(&[2], 0)]).expect("a work");
        let Work::Boxes(boxes) = &found.work else { panic!("boxes") };
        let present = |step: usize| {
            let state = boxes.step(step).0.iter().enumerate();
            state.filter(|(_, b)| **b != Aabb::EMPTY).map(|(i, _)| i).collect::<Vec<_>>()
        };
        assert_eq!([0, 1, 2].map(present), [vec![0, 1, 5], vec![0, 1, 5], vec![2]]);
        let large = stream(vec![edit(&[7, 1 << 28], 0)]);
        assert!(matches!(large, Err(WorkloadError::TooLarge { index, .. }) if index == 1 << 28));
        assert!(matches!(stream(vec![]), Err(WorkloadError::Empty)));
    }
}
