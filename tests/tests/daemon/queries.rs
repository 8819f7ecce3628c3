//! Queries of scenes and frames of two sets: in process, by a daemon, and when the daemon is killed. Every
//! answer is what comparing each with each gives.

use pairmask::{Margin, QueryAnswer, SceneEdit, SceneOptions};
use pairmask_core::cast::Hit;
use pairmask_core::filters::FilterData;
use pairmask_core::scene::{Cast, QueryError, Scene, SceneOptions as CoreOptions, between};
use pairmask_tests::frames::two_sets;
use pairmask_tests::prelude::*;
use pairmask_tests::queried::{QueriedScene, Queries, a_query};
use pairmask_tests::scene_model::{Bare, Kind, hold, options, overlap};
use pairmask_tests::stress_scenes::Rng;

/// Edits and queries a scene for a while, with rules where the seed is odd. Returns how many pairs were found.
fn check(scene: &mut impl QueriedScene, seed: u64, largest: u32, rounds: usize) -> usize {
    let mut queries = Queries::new(seed, largest, seed % 2 == 1);
    let counts = [0, 1, 2, 7, 8, 9, 40, 70].into_iter().cycle().take(rounds);
    counts.map(|count| queries.check(scene, count)).sum()
}

struct Remote<'a> {
    scene: pairmask::Scene,
    before: Box<dyn FnMut() + 'a>,
    served: Vec<ServedBy>,
}

impl<'a> Remote<'a> {
    fn new(scene: pairmask::Scene, before: impl FnMut() + 'a) -> Self {
        Self { scene, before: Box::new(before), served: Vec::new() }
    }
}

/// All ways to read an answer give the same.
fn read(answer: &QueryAnswer, queries: u32) -> Vec<Pair> {
    let pairs = answer.to_vec();
    assert!(answer.iter().eq(pairs.iter().copied()));
    assert_eq!((answer.count(), answer.is_empty()), (pairs.len() as u64, pairs.is_empty()));
    let by_query = (0..queries).flat_map(|q| answer.of_query(q).map(move |index| [q, index]));
    assert!(by_query.eq(pairs.iter().copied()));
    assert_eq!(answer.of_query(queries).count(), 0);
    let mask = answer.mask();
    assert_eq!(mask.n().get(), queries + answer.index_end());
    assert_eq!(mask.view().verify(), Ok(()));
    let of_mask = mask.pairs().map(|[a, b]| [a, b - queries]);
    assert!(of_mask.eq(pairs.iter().copied()));
    for [query, index] in pairs.iter().take(5) {
        assert!(mask.contains(*query, queries + index));
    }
    pairs
}

impl QueriedScene for Remote<'_> {
    fn edit(&mut self, edit: Edit<'_>) {
        (self.before)();
        let edit = edit.steps.iter().copied().fold(self.scene.edit(), SceneEdit::step);
        drop(edit.commit(Report::Changes).unwrap());
    }

    fn query(
        &mut self,
        queries: &[Aabb],
        filter_data: QueryFilterData<'_>,
        encoding: Encoding,
    ) -> Vec<Pair> {
        (self.before)();
        let answer = self.scene.query_as(queries, filter_data, encoding).unwrap();
        assert_eq!(answer.mask().encoding(), encoding);
        self.served.push(answer.served_by());
        read(&answer, queries.len() as u32)
    }

    fn cast(&mut self, cast: &Cast<'_>) -> Vec<Hit> {
        (self.before)();
        let answer = self.scene.cast_filtered(cast.shapes, cast.hits, cast.filter_data).unwrap();
        self.served.push(answer.served_by());
        let queries = cast.shapes.len() as u32;
        assert_eq!(answer.queries(), queries);
        let by_query: Vec<Hit> = (0..=queries).flat_map(|q| answer.of_query(q)).copied().collect();
        assert_eq!(by_query, answer.hits());
        by_query
    }
}

#[test]
fn scenes_of_all_small_sizes_are_queried() {
    let mut found = 0;
    for largest in 0..70 {
        let mut scene = Scene::new(CoreOptions::default().with_threads(1));
        found += check(&mut scene, u64::from(largest), largest, 40);
    }
    assert!(found > 10_000, "{found}");
}

#[test]
fn larger_scenes_are_queried_by_few_and_by_many() {
    for (seed, largest, threads) in [(1, 700, 2), (2, 3_001, 3), (3, 6_007, 2)] {
        let mut scene = Scene::new(CoreOptions::default().with_threads(threads));
        let mut queries = Queries::new(seed, largest, seed == 1);
        let counts = [1, 5, 63, 64, 65, 700, 129, 1, 300].into_iter().cycle().take(40);
        let found: usize = counts.map(|count| queries.check(&mut scene, count)).sum();
        assert!(found > 1_000, "{found}");
    }
}

#[test]
fn a_query_changes_nothing_that_edits_report() {
    for (kind, edits) in [(Kind::Small, 1_000), (Kind::Large, 40)] {
        hold(kind, 100_000, edits, |script| Bare::asked(Scene::new(options(script)), 1));
    }
}

#[test]
fn a_query_that_finds_too_much_is_refused_and_the_scene_stays() {
    let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 500];
    let mut scene = Scene::new(CoreOptions::default().with_threads(2));
    scene.edit(Edit { steps: &sets_all(&boxes) }, Report::Nothing).unwrap();
    let (few, many) = ([boxes[0]; 3], [boxes[0]; 400]);
    let mut found = Vec::new();
    scene.limit_query_pairs(1_500);
    for queries in [&few[..], &many, &few] {
        let asked = scene.query(queries, QueryFilterData::None, &mut found);
        if queries.len() == 3 {
            assert_eq!((asked.is_ok(), found.len()), (true, 1_500));
        } else {
            let Err(QueryError::Cull(CullError::Reserve(error))) = asked else {
                panic!("{asked:?}")
            };
            let too_large = ReserveError::TooLarge { at_least_bytes: 12_008, limit_bytes: 12_000 };
            assert_eq!(error, too_large);
        }
    }
    scene.limit_query_pairs(1_499);
    assert!(scene.query(&few, QueryFilterData::None, &mut found).is_err());
}

#[test]
fn each_query_needs_its_filter_data() {
    let mut scene = Scene::new(CoreOptions::default());
    let (queries, filter_data) = ([Aabb::EMPTY; 3], [FilterData::default(); 2]);
    let asked = scene.query(&queries, QueryFilterData::Each(&filter_data), &mut Vec::new());
    assert!(matches!(asked, Err(QueryError::FilterData { queries: 3, filter_data: 2 })));
}

#[test]
fn a_daemon_is_queried() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--audit", "1/1"]);
    let mut session = daemon.connect();
    let without = SceneOptions::default();
    // Of boxes with margins, what is found are the boxes as they were set.
    let exact = without.clone().with_margin(Margin::new(0.7).unwrap());
    let near = exact.clone().with_near_pairs(true);
    for (seed, largest, rounds) in [(1, 30, 80), (2, 70, 80), (3, 700, 60)] {
        for options in [&without, &near, &exact] {
            let mut scene = Remote::new(session.scene(options.clone()).unwrap(), || ());
            assert!(check(&mut scene, seed, largest, rounds) > 100);
            assert!(scene.served.contains(&ServedBy::Daemon));
        }
    }
    let mut scene = Remote::new(session.scene(SceneOptions::default()).unwrap(), || ());
    let mut queries = Queries::new(5, 6_000, true);
    let found: usize =
        [300, 5, 1_000].into_iter().map(|count| queries.check(&mut scene, count)).sum();
    assert!(found > 0);
    drop(scene);
    daemon.audit_is_clean(|audit| audit.pairs > 0);
}

#[test]
fn a_shared_scene_is_queried() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--audit", "1/1"]);
    let mut session = daemon.connect();
    for (seed, largest, rounds) in [(31, 30, 80), (32, 70, 80), (33, 700, 60)] {
        let options = SceneOptions::default().with_most_boxes(largest);
        let mut scene = session.scene(options.with_shared(format!("queried-{seed}"))).unwrap();
        scene.lease(0..largest).unwrap();
        assert!(check(&mut Remote::new(scene, || ()), seed, largest, rounds) > 100);
    }
    daemon.audit_is_clean(|audit| audit.pairs > 0);
}

#[test]
fn a_daemon_with_a_gpu_is_queried() {
    let daemon = TestDaemon::start(&["--gpu", "software", "--audit", "1/1"]);
    let mut session = daemon.connect_to(EngineName::GpuGrid);
    for (seed, largest, rounds) in [(21, 20, 30), (22, 300, 30), (23, 3_001, 10)] {
        let mut scene = Remote::new(session.scene(SceneOptions::default()).unwrap(), || ());
        let found = check(&mut scene, seed, largest, rounds);
        assert!(found > 20, "{found}");
        assert!(scene.served.contains(&ServedBy::Daemon));
    }
    daemon.audit_is_clean(|audit| audit.pairs > 0);
}

#[test]
fn queries_outlive_a_daemon_that_is_killed() {
    let (daemon, mut session) = served_or_here();
    let mut requests = 0;
    let mut scene = Remote::new(session.scene(SceneOptions::default()).unwrap(), || {
        requests += 1;
        if requests % 23 == 0 {
            daemon.signal_worker(Signal::KILL);
        }
    });
    check(&mut scene, 7, 70, 120);
    assert!(scene.served.contains(&ServedBy::Daemon));
}

#[test]
fn a_reply_that_is_too_small_refuses_a_query_and_the_scene_stays() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-reply-mib", "1"]);
    let boxes = vec![Aabb::new([0.0; 3], [1.0; 3]); 2_000];
    for (backend, is_answered) in [(Backend::Daemon, false), (Backend::Auto, true)] {
        let mut session = daemon.session().backend(backend).connect().unwrap();
        let mut scene = session.scene(SceneOptions::default()).unwrap();
        let set = scene.edit().set_all(0..2_000, &boxes);
        drop(set.commit(Report::Nothing).unwrap());
        for (queries, fits) in [(2, true), (1_000, false), (3, true)] {
            match scene.query(&boxes[..queries]) {
                Ok(found) => {
                    assert!(fits || is_answered);
                    assert_eq!(found.count(), 2_000 * queries as u64);
                    let by = if fits { ServedBy::Daemon } else { ServedBy::InProcess };
                    assert_eq!(found.served_by(), by);
                }
                Err(error) => {
                    assert!(!fits && !is_answered, "{error}");
                    assert!(matches!(error, Error::Reply(_)), "{error}");
                }
            }
        }
    }
}

#[test]
fn the_model_notices_a_pair_and_a_hit_that_are_missing() {
    struct Discarding(Scene, [bool; 2]);
    impl QueriedScene for Discarding {
        fn edit(&mut self, edit: Edit<'_>) {
            QueriedScene::edit(&mut self.0, edit);
        }
        fn query(
            &mut self,
            boxes: &[Aabb],
            filter_data: QueryFilterData<'_>,
            e: Encoding,
        ) -> Vec<Pair> {
            let mut found = QueriedScene::query(&mut self.0, boxes, filter_data, e);
            found.truncate(found.len() - usize::from(self.1[0] && !found.is_empty()));
            found
        }
        fn cast(&mut self, cast: &Cast<'_>) -> Vec<Hit> {
            let mut found = QueriedScene::cast(&mut self.0, cast);
            found.truncate(found.len() - usize::from(self.1[1] && !found.is_empty()));
            found
        }
    }
    for (discards, is_right) in
        [([false, false], true), ([true, false], false), ([false, true], false)]
    {
        let mut scene = Discarding(Scene::new(CoreOptions::default()), discards);
        let checked =
            std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| check(&mut scene, 4, 40, 80)));
        assert_eq!(checked.is_ok(), is_right);
    }
}

fn naive(first: &[Aabb], second: &[Aabb]) -> Vec<Pair> {
    let pairs = (0..).zip(first).flat_map(|(a, x)| {
        let met = (0..).zip(second).filter(|(_, y)| overlap(x, y));
        met.map(move |(b, _)| [a, b])
    });
    pairs.collect()
}

#[test]
fn two_sets_meet_each_other_alone() {
    let mut rng = Rng::new(9);
    let sizes = (0..70).map(|i| (i, (i * 37) % 71)).chain([(5_000, 3), (301, 1_999)]);
    for (a, b) in sizes {
        let extent = if a * b < 5_000 { 8.0 } else { 30.0 };
        let [first, second] = [a, b]
            .map(|count| (0..count).map(|_| a_query(&mut rng, extent)).collect::<Vec<Aabb>>());
        let expected = naive(&first, &second);
        let most = expected.len() as u64;
        for threads in [1, 2] {
            let mut found = Vec::new();
            between(&first, &second, Some(threads), most, &mut found).unwrap();
            assert!(found == expected, "{a} against {b}");
            let refused = most > 0 && between(&first, &second, None, most - 1, &mut found).is_ok();
            assert!(!refused, "more pairs than may be");
        }
    }
}

/// Culls frames of two sets of a session, and some whole ones between.
fn check_sets(session: &mut Session, encoding: Encoding, by: (ServedBy, Option<EngineName>)) {
    let mut rng = Rng::new(17);
    for (a, b) in [(0, 0), (0, 5), (5, 0), (1, 69), (33, 31), (64, 65), (3, 2_000), (901, 700)] {
        let boxes: Vec<Aabb> = (0..a + b).map(|_| a_query(&mut rng, 12.0)).collect();
        let mask = session.ask_with(&boxes, &two_sets(a)).wait().unwrap();
        let info = mask.info();
        let what = format!("{a} against {b}, {encoding}, {}", info.engine);
        assert!(info.served_by == by.0, "{what}");
        // An empty frame needs no GPU.
        assert!(a * b == 0 || by.1.is_none_or(|engine| info.engine == engine), "{what}");
        assert_eq!((mask.encoding(), mask.n().len()), (encoding, a + b));
        assert_eq!(mask.view().verify(), Ok(()));
        let (first, second) = boxes.split_at(a);
        let expected: Vec<Pair> =
            naive(first, second).iter().map(|[x, y]| [*x, a as u32 + y]).collect();
        assert_eq!(mask.sorted(), expected, "{what}");
        assert_eq!(mask.count(), expected.len() as u64);
        let invalid = boxes.iter().filter(|b| b.class() == BoxClass::Invalid).count();
        assert_eq!(info.census.invalid as usize, invalid);
        drop(mask);
        // The same boxes as one set.
        assert_eq!(session.answer(&boxes).sorted(), oracle::truth(&boxes).pairs);
    }
    let refused = session.frame(3).unwrap().submit_with(&two_sets(4));
    assert!(matches!(refused, Err(Error::FirstSet { first: 4, n: 3 })));
}

#[test]
fn frames_of_two_sets_are_culled_in_process_by_a_daemon_and_by_a_gpu() {
    let daemon = TestDaemon::start(&["--gpu", "software", "--audit", "1/1"]);
    let backends = [(Backend::InProcess, ServedBy::InProcess), (Backend::Daemon, ServedBy::Daemon)];
    for encoding in Encoding::ALL {
        let builder = daemon.session().encoding(EncodingChoice::Only(encoding));
        for (backend, by) in backends {
            let cores = builder.clone().engine(EngineChoice::Auto).backend(backend);
            check_sets(&mut cores.connect().unwrap(), encoding, (by, None));
        }
        let engines = match encoding {
            Encoding::Dense => vec![EngineName::GpuBrute],
            Encoding::Sparse => vec![EngineName::GpuGrid],
            _ => vec![EngineName::GpuGrid, EngineName::GpuBrute],
        };
        for engine in engines {
            let only = builder.clone().engine(EngineChoice::Only(engine));
            let by = (ServedBy::Daemon, Some(engine));
            check_sets(&mut only.connect().unwrap(), encoding, by);
        }
    }
    daemon.audit_is_clean(|audit| audit.pairs > 0);
}

#[test]
fn frames_of_two_sets_outlive_a_daemon_that_is_killed() {
    let (daemon, mut session) = served_or_here();
    let boxes = stress_scenes::named("uniform").boxes(500, 3);
    let (first, second) = boxes.split_at(100);
    let expected: Vec<Pair> = naive(first, second).iter().map(|[a, b]| [*a, 100 + b]).collect();
    for round in 0..30 {
        let pending = session.ask_with(&boxes, &two_sets(100));
        if round % 7 == 3 {
            daemon.signal_worker(Signal::KILL);
        }
        assert_eq!(pending.wait().unwrap().to_vec(), expected);
    }
}
