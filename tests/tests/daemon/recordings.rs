//! Recordings: what clients sent is sent again, and has the same answers, on every engine.

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use pairmask::FrameOptions;
use pairmask::filters::{FilterData, FilterId, Owner, Rules, World};
use pairmask_core::cast::{Hits, Ray};
use pairmask_core::engine::AvailableIsa;
use pairmask_tests::gpu;
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::{
    Kind, SessionScene, Sessions, SharedMembers, hold, hold_all, script_of,
};
use pairmask_tests::stress_scenes::Rng;
use pairmask_wire::InstanceName;
use pairmaskd::precision::PrecisionChoice;
use pairmaskd::recording::{
    Answered, Event, ReadError, Record, RecordFile, RecordSettings, Recording, SessionEnd,
};
use pairmaskd::replay::{Pace, Player, Tally, replay};

/// A daemon of cores that records, and the file.
struct Recorded {
    daemon: TestDaemon,
    folder: tempfile::TempDir,
}

impl Recorded {
    fn start(more: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.pmrec").display().to_string();
        let arguments = [&["--gpu", "none", "--record", &file], more].concat();
        Self { daemon: TestDaemon::start(&arguments), folder }
    }

    fn file(&self) -> PathBuf {
        self.folder.path().join("a.pmrec")
    }

    /// The recording, once the daemon has ended.
    fn bytes(mut self) -> Vec<u8> {
        self.daemon.stop();
        fs::read(self.file()).unwrap()
    }
}

/// All records, and why there are no more.
fn records(bytes: &[u8]) -> (Vec<Record>, Option<ReadError>) {
    let mut recording = match Recording::open(Cursor::new(bytes)) {
        Ok(recording) => recording,
        Err(error) => return (Vec::new(), Some(error)),
    };
    let mut records = Vec::new();
    loop {
        match recording.next_block() {
            Ok(Some(block)) => records.extend(block),
            Ok(None) => return (records, None),
            Err(error) => return (records, Some(error)),
        }
    }
}

fn write(path: &Path, records: &[Record]) {
    let settings = RecordSettings { file: path.to_owned(), most_bytes: u64::MAX };
    let mut file = RecordFile::create(&settings).unwrap();
    for record in records {
        file.write(record).unwrap();
    }
    file.flush().unwrap();
}

fn player(daemon: &TestDaemon) -> Player {
    Player::new(daemon.dir(), InstanceName::default())
}

fn replayed(bytes: &[u8], players: &mut [Player]) -> Tally {
    let mut recording = Recording::open(Cursor::new(bytes)).unwrap();
    replay(&mut recording, players, Pace::Fast).unwrap()
}

fn holds(tally: &Tally, what: &str) {
    assert_eq!(tally.differing(), 0, "{what}: {:?}", tally.described);
    assert_eq!((tally.uncompared(), tally.cut_sessions), (0, 0), "{what}");
    assert!(tally.ends_early.is_none(), "{what}: {:?}", tally.ends_early);
}

/// Frames in every form, with rules and without, of two sets, and of spheres.
fn random_frames(session: &mut Session, count: usize, seed: u64) {
    let mut rng = Rng::new(seed);
    let mut rules = Arc::new(Rules::default());
    for frame in 0..count {
        let n = rng.below(200) as usize;
        let boxes: Vec<Aabb> = (0..n)
            .map(|_| {
                let min = [(); 3].map(|()| rng.below(400) as f32 / 40.0);
                Aabb::new(min, min.map(|x| x + rng.below(60) as f32 / 40.0))
            })
            .collect();
        let bounds = Bounds::new([0.0; 3], [12.0; 3]).unwrap();
        let precision = [Precision::Q16(bounds), Precision::Q8(bounds), Precision::F16];
        let pending = match frame % 8 {
            0 => {
                let mut frame = session.sphere_frame(n).unwrap();
                for (sphere, b) in frame.spheres_mut().iter_mut().zip(&boxes) {
                    *sphere = Sphere::new(b.min, b.max[0] - b.min[0]);
                }
                frame.submit().unwrap()
            }
            narrow @ 1..=3 => {
                let mut frame = session.narrow_frame(n, precision[narrow - 1]).unwrap();
                frame.write(&boxes).unwrap();
                frame.submit().unwrap()
            }
            form => {
                if frame % 80 == 4 {
                    let mut others = Rules::default();
                    let data =
                        |i: u32| FilterData::new(World((i % 3) as i32), Owner(i / 5), FilterId(0));
                    others.filter_data = (0..200).map(data).collect();
                    others.filter_data.truncate(n);
                    rules = Arc::new(others);
                }
                let mut options = FrameOptions::default();
                match form {
                    4 if rules.filter_data.len() == n => options.filters = Some(Arc::clone(&rules)),
                    5 => options.split_at = Some(n / 3),
                    _ => {}
                }
                let mut frame = session.frame(n).unwrap();
                frame.write(&boxes).unwrap();
                frame.submit_with(&options).unwrap()
            }
        };
        pending.wait().unwrap();
    }
}

/// Edits of scenes by scripts, and queries and casts beside them.
fn random_scenes(session: &mut Session, kinds: [(Kind, usize); 3], seed: u64) {
    hold_all(script_of, seed, kinds, |script| {
        SessionScene::of(session, script, ServedBy::Daemon, EngineName::CpuGrid)
    });
    let mut scene = session.scene(pairmask::SceneOptions::default()).unwrap();
    let mut rng = Rng::new(seed);
    for step in 0..50 {
        let min = [(); 3].map(|()| rng.below(100) as f32 / 10.0);
        let b = Aabb::new(min, min.map(|x| x + 1.0));
        drop(scene.edit().set(step, b).commit(pairmask::Report::Changes).unwrap());
        scene.query(&[b, Aabb::point([5.0; 3])]).unwrap();
        scene.cast(&[Ray::new([0.0; 3], min)], Hits::All).unwrap();
        scene.nearest(&[Sphere::new(min, 2.0)], Hits::Closest(3)).unwrap();
    }
}

#[test]
fn ten_thousand_requests_replay_to_the_same_pairs_on_every_engine_of_cores() {
    let recorded = Recorded::start(&[]);
    let mut session = recorded.daemon.connect();
    random_frames(&mut session, 5_000, 1);
    random_scenes(
        &mut session,
        [(Kind::Small, 5_000), (Kind::Crowd, 20), (Kind::Large, 20)],
        200_000,
    );
    drop(session);
    let bytes = recorded.bytes();
    let daemon = TestDaemon::of_cores();
    for engine in EngineName::CPU {
        let engine = EngineChoice::Only(engine);
        let tally = replayed(&bytes, &mut [player(&daemon).with_engine(Some(engine))]);
        holds(&tally, &engine.to_string());
        assert!(tally.requests() >= 10_000, "{}", tally.requests());
        let kinds: Vec<u64> = tally.rows().map(|row| row.requests).collect();
        assert!(
            kinds.len() == 5 && kinds[0] == 5_000,
            "frames, edits, queries, casts, others: {kinds:?}"
        );
    }
}

#[test]
fn requests_replay_to_the_same_pairs_on_engines_of_a_gpu() {
    let recorded = Recorded::start(&[]);
    let mut session = recorded.daemon.connect();
    // A software adapter takes no spheres by name.
    let mut rng = Rng::new(3);
    for n in [0, 1, 70, 300] {
        let at = |rng: &mut Rng| [(); 3].map(|()| rng.below(100) as f32 / 10.0);
        let boxes: Vec<Aabb> =
            (0..n).map(|_| at(&mut rng)).map(|a| Aabb::new(a, a.map(|x| x + 1.0))).collect();
        let mut frame = session.frame(n).unwrap();
        frame.write(&boxes).unwrap();
        frame.submit().unwrap().wait().unwrap();
    }
    random_scenes(&mut session, [(Kind::Small, 100), (Kind::Crowd, 2), (Kind::Large, 2)], 210_000);
    drop(session);
    let bytes = recorded.bytes();
    let gpu = gpu::name();
    let daemon = TestDaemon::start(&["--gpu", &gpu]);
    for engine in [EngineName::GpuBrute, EngineName::GpuGrid] {
        let engine = EngineChoice::Only(engine);
        let tally = replayed(&bytes, &mut [player(&daemon).with_engine(Some(engine))]);
        holds(&tally, &engine.to_string());
        assert!(tally.requests() > 100);
    }
}

#[test]
fn requests_replay_to_the_same_pairs_in_process() {
    let recorded = Recorded::start(&[]);
    let mut session = recorded.daemon.connect();
    random_frames(&mut session, 1_000, 21);
    random_scenes(
        &mut session,
        [(Kind::Small, 1_000), (Kind::Crowd, 5), (Kind::Large, 5)],
        240_000,
    );
    drop(session);
    let bytes = recorded.bytes();
    for isa in Isa::ALL.into_iter().filter_map(AvailableIsa::new) {
        let tally = replayed(&bytes, &mut [Player::in_process(isa)]);
        holds(&tally, isa.get().as_str());
        assert!(tally.requests() >= 2_000 && tally.skipped() == 0, "{}", tally.skipped());
    }
    // Beside a daemon, pair by pair.
    let daemon = TestDaemon::of_cores();
    let here = Player::in_process(AvailableIsa::best()).keeping_entries();
    holds(&replayed(&bytes, &mut [here, player(&daemon).keeping_entries()]), "beside a daemon");
}

#[test]
fn frames_replay_in_less_precision_with_more_pairs_and_none_missed() {
    let recorded = Recorded::start(&[]);
    let mut session = recorded.daemon.connect();
    random_frames(&mut session, 400, 23);
    random_scenes(&mut session, [(Kind::Small, 100), (Kind::Crowd, 1), (Kind::Large, 1)], 230_000);
    drop(session);
    let bytes = recorded.bytes();
    let daemon = TestDaemon::of_cores();
    for mode in ["q16", "q8", "f16", "margin=0.2"] {
        let precision: PrecisionChoice = mode.parse().unwrap();
        let exact = [player(&daemon), Player::in_process(AvailableIsa::best())];
        for exact in exact {
            let narrow = player(&daemon).with_precision(precision).keeping_entries();
            let tally = replayed(&bytes, &mut [narrow, exact.keeping_entries()]);
            holds(&tally, mode);
            // One in eight is of spheres, three in eight were sent as narrow boxes.
            assert_eq!(tally.narrowed(), 200, "{mode}");
            assert!(tally.extra_pairs() > 0, "{mode} adds pairs");
        }
    }
}

#[test]
fn shared_scenes_replay_tick_by_tick() {
    let recorded = Recorded::start(&[]);
    let sessions = Sessions::new(&recorded.daemon.session());
    hold(Kind::Shared, 220_000, 300, |script| SharedMembers::new(&sessions, script, None));
    drop(sessions);
    let bytes = recorded.bytes();
    let daemon = TestDaemon::of_cores();
    let tally = replayed(&bytes, &mut [player(&daemon)]);
    holds(&tally, "shared");
    assert!(tally.requests() > 300);
    let tally = replayed(&bytes, &mut [Player::in_process(AvailableIsa::best())]);
    assert_eq!((tally.differing(), tally.skipped()), (0, tally.requests()), "they need a daemon");
}

/// A recording of some hundred requests in several blocks.
fn a_recording() -> Vec<u8> {
    let recorded = Recorded::start(&[]);
    let mut session = recorded.daemon.connect();
    random_frames(&mut session, 200, 7);
    random_scenes(&mut session, [(Kind::Small, 100), (Kind::Crowd, 1), (Kind::Large, 1)], 230_000);
    drop(session);
    let (all, end) = records(&recorded.bytes());
    assert!(end.is_none() && all.len() > 500, "{} {end:?}", all.len());
    // Blocks as a recording of some minutes has them.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("blocks");
    let settings = RecordSettings { file: file.clone(), most_bytes: u64::MAX };
    let mut writer = RecordFile::create(&settings).unwrap();
    for (at, record) in all.iter().enumerate() {
        writer.write(record).unwrap();
        if at % 40 == 39 {
            writer.flush().unwrap();
        }
    }
    writer.flush().unwrap();
    let bytes = fs::read(file).unwrap();
    let (again, end) = records(&bytes);
    assert!(end.is_none() && again == all, "written and read");
    bytes
}

#[test]
fn a_recording_that_is_cut_or_forged_is_read_up_to_there() {
    let bytes = a_recording();
    let (all, _) = records(&bytes);
    let mut ends = vec![];
    let mut recording = Recording::open(Cursor::new(&bytes)).unwrap();
    let mut whole = 0;
    ends.push((recording.at(), 0));
    while let Some(block) = recording.next_block().unwrap() {
        whole += block.len();
        ends.push((recording.at(), whole));
    }
    assert!(ends.len() > 10);
    let mut rng = Rng::new(9);
    for _ in 0..1_000 {
        let cut = u64::from(rng.below(bytes.len() as u32));
        let (read, end) = records(&bytes[..cut as usize]);
        match ends.iter().rev().find(|(at, _)| *at <= cut) {
            None => assert!(matches!(end, Some(ReadError::NoRecording)), "{cut}: {end:?}"),
            Some((at, count)) => {
                assert!(read == all[..*count], "cut at {cut}");
                match end {
                    None => assert_eq!(cut, *at),
                    Some(ReadError::Cut { at: said }) => assert_eq!(said, *at),
                    other => panic!("cut at {cut}: {other:?}"),
                }
            }
        }
    }
    for _ in 0..2_000 {
        let mut forged = bytes.clone();
        for _ in 0..=rng.below(3) {
            let at = rng.below(bytes.len() as u32) as usize;
            forged[at] ^= 1 << rng.below(8);
        }
        let (read, end) = records(&forged);
        assert!(read == all[..read.len()], "what is read is what was written: {end:?}");
        assert!(end.is_some() || read.len() == all.len(), "what is missing is said");
    }
}

#[test]
fn an_answer_that_differs_is_counted_and_named() {
    let bytes = a_recording();
    let (mut all, _) = records(&bytes);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("other");
    let of = |record: &mut Record| match &mut record.event {
        Event::Answer { number, answered } if answered.count > 3 => Some((*number, *answered)),
        _ => None,
    };
    let lies: [fn(&mut Answered); 3] =
        [|a| a.digest ^= 1, |a| a.count -= 1, |a| (a.status, a.digest, a.count) = (7, 0, 0)];
    let answers: Vec<usize> =
        (0..all.len()).filter(|at| of(&mut all[*at].clone()).is_some()).take(3).collect();
    let mut numbers = Vec::new();
    for (at, lie) in answers.iter().zip(lies) {
        if let Event::Answer { number, answered } = &mut all[*at].event {
            lie(answered);
            numbers.push(*number);
        }
    }
    write(&file, &all);
    let daemon = TestDaemon::of_cores();
    let tally = replayed(&fs::read(&file).unwrap(), &mut [player(&daemon)]);
    let mut named: Vec<u64> = tally.described.iter().map(|d| d.request).collect();
    named.sort_unstable();
    assert_eq!((tally.differing(), named), (3, numbers), "{:?}", tally.described);
    // Two engines beside each other, pair by pair.
    let engines = [EngineName::CpuSap, EngineName::CpuBrute].map(EngineChoice::Only);
    let mut players =
        engines.map(|engine| player(&daemon).with_engine(Some(engine)).keeping_entries());
    holds(&replayed(&bytes, &mut players), "two engines");
}

#[test]
fn a_worker_that_is_killed_leaves_a_recording_that_its_successor_goes_on_with() {
    let recorded = Recorded::start(&[]);
    let mut session = recorded.daemon.session().backend(Backend::Auto).connect().unwrap();
    random_frames(&mut session, 100, 11);
    // What is older than a second is written.
    until("the first frames are in the file", || {
        let (records, _) = records(&fs::read(recorded.file()).unwrap());
        records.iter().filter(|record| matches!(record.event, Event::Request { .. })).count() >= 100
    });
    recorded.daemon.signal_worker(Signal::KILL);
    until("the daemon serves again", || {
        random_frames(&mut session, 1, 12);
        session.served_by() == ServedBy::Daemon
    });
    random_frames(&mut session, 100, 13);
    drop(session);
    let bytes = recorded.bytes();
    let (all, end) = records(&bytes);
    assert!(end.is_none(), "{end:?}");
    assert_eq!(all.iter().filter(|record| record.event == Event::WorkerBegan).count(), 1);
    let daemon = TestDaemon::of_cores();
    let tally = replayed(&bytes, &mut [player(&daemon)]);
    assert_eq!(tally.differing(), 0, "{:?}", tally.described);
    assert!(tally.requests() >= 200, "{}", tally.requests());
}

#[test]
fn a_recording_ends_at_its_largest_size_and_the_daemon_serves_on() {
    let recorded = Recorded::start(&["--record-max", "1M"]);
    let mut session = recorded.daemon.connect();
    random_frames(&mut session, 4_000, 17);
    drop(session);
    let bytes = recorded.bytes();
    assert!(bytes.len() <= 1 << 20, "{}", bytes.len());
    let (all, end) = records(&bytes);
    assert!(end.is_none() && !all.is_empty(), "{end:?}");
    assert!(
        !all.iter()
            .any(|r| matches!(r.event, Event::SessionEnded { why: SessionEnd::TooFast, .. }))
    );
}

#[test]
fn every_recording_in_the_repository_replays() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings");
    let mut files: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "pmrec"))
        .collect();
    files.sort();
    assert_eq!(files.len(), 11, "{files:?}");
    let daemon = TestDaemon::of_cores();
    for file in files {
        let bytes = fs::read(&file).unwrap();
        let tally = replayed(&bytes, &mut [player(&daemon)]);
        assert_eq!(tally.differing(), 0, "{}: {:?}", file.display(), tally.described);
        let here = replayed(&bytes, &mut [Player::in_process(AvailableIsa::best())]);
        assert_eq!(here.differing(), 0, "{}, in process: {:?}", file.display(), here.described);
        // Answers that no client waited for.
        assert!(20 * tally.uncompared() < tally.requests(), "{}", file.display());
        assert!(tally.requests() > 20, "{}", file.display());
    }
}
