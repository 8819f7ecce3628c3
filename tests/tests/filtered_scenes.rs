//! Scenes with rules: in process, by a daemon with cores and with a GPU, and when the daemon is killed. Every
//! answer is what a model says that knows every box, every rule and every pair.
#![allow(clippy::unwrap_used)]

use pairmask::{Backend, EngineChoice, EngineName, SceneEdit, ServedBy};
use pairmask_core::Aabb;
use pairmask_core::filters::{Tag, World};
use pairmask_core::scene::{
    Edit, EditError, Scene, SceneError, SceneOptions, Sets, Step, Tags, Want,
};
use pairmask_tests::daemon::{TestDaemon, eventually};
use pairmask_tests::filtered_world::{EditsLike, RuledScene, ToldPairs, check_scene};
use rustix::process::Signal;

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");

const fn like(seed: u64, limit: u32, extent: u32, changes: u32, edits: u32) -> EditsLike {
    EditsLike { seed, limit, extent, changes, edits }
}

fn options(limit: u32) -> SceneOptions {
    SceneOptions::default().with_most_boxes(limit.max(1))
}

fn check(like: EditsLike, threads: usize) -> [u32; 3] {
    let mut scene = Scene::new(options(like.limit).with_threads(threads));
    check_scene(&mut scene, like)
}

/// A scene of a session.
struct Remote<'a> {
    scene: pairmask::Scene,
    /// What is done before an edit.
    before: Box<dyn FnMut() + 'a>,
    served: Vec<(ServedBy, String)>,
}

impl<'a> Remote<'a> {
    fn new(scene: pairmask::Scene, before: impl FnMut() + 'a) -> Self {
        Self { scene, before: Box::new(before), served: Vec::new() }
    }
}

impl RuledScene for Remote<'_> {
    fn edit(&mut self, steps: &[Step<'_>], want: Want, takes: bool) -> ToldPairs {
        (self.before)();
        let edit = steps.iter().copied().fold(self.scene.edit(), SceneEdit::step);
        let answer = edit.commit(want).unwrap();
        let answer = if takes { answer.take() } else { answer };
        self.served.push((answer.served_by(), answer.engine().to_string()));
        ToldPairs {
            is_resync: answer.is_resync(),
            begun: answer.begun().to_vec(),
            ended: answer.ended().to_vec(),
            pairs: answer.pairs().to_vec(),
            pair_count: answer.pair_count(),
        }
    }

    fn lose(&mut self) {
        self.scene.lose();
    }
}

#[test]
fn a_daemon_knows_the_rules() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none", "--audit", "1/1"]);
    let mut session = daemon.session().backend(Backend::Daemon).connect().unwrap();
    let likes = [like(1, 40, 16, 8, 150), like(2, 160, 26, 20, 150), like(3, 3_000, 70, 60, 30)];
    for like in likes {
        let mut scene = Remote::new(session.scene(options(like.limit)), || ());
        check_scene(&mut scene, like);
    }
    let audit = eventually("scenes are audited", || {
        // The auditor gives up a scene that is edited faster than it follows: then there is another one.
        let mut scene = Remote::new(session.scene(options(likes[1].limit)), || ());
        check_scene(&mut scene, likes[1]);
        let audit = session.daemon_status().unwrap().audit;
        (audit.frames > 100 && audit.pairs > 10_000).then_some(audit)
    });
    assert_eq!((audit.missed, audit.extra), (0, 0), "{audit:?}");
}

#[test]
fn a_gpu_has_the_same_rules() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "software"]);
    let engine = EngineChoice::Only(EngineName::GpuGrid);
    let mut session = daemon.session().backend(Backend::Daemon).engine(engine).connect().unwrap();
    for like in [like(11, 40, 16, 8, 80), like(12, 160, 26, 20, 80), like(13, 3_000, 70, 60, 15)] {
        let mut scene = Remote::new(session.scene(options(like.limit)), || ());
        check_scene(&mut scene, like);
        let gpu = |(served, engine): &(ServedBy, String)| {
            *served == ServedBy::Daemon && engine == EngineName::GpuGrid.as_str()
        };
        assert!(scene.served.iter().all(gpu));
    }
}

#[test]
fn rules_outlive_a_daemon_that_is_killed() {
    let daemon = std::cell::RefCell::new(TestDaemon::start(DAEMON, &["--gpu", "none"]));
    let mut session = daemon.borrow().session().backend(Backend::Auto).connect().unwrap();
    let mut edits = 0;
    let mut scene = Remote::new(session.scene(options(160)), || {
        edits += 1;
        if edits % 25 == 0 {
            daemon.borrow().signal_worker(Signal::KILL);
        }
    });
    check_scene(&mut scene, like(21, 160, 26, 20, 150));
    assert!(scene.served.iter().any(|(served, _)| *served == ServedBy::Daemon));
}

#[test]
fn scenes_of_all_small_sizes_tell_what_the_rules_let_meet() {
    for n in 0..70 {
        check(like(u64::from(n) + 1, n, 12 + n / 4, 8, 60), 1);
    }
}

#[test]
fn changes_of_rules_are_told_once_with_their_reasons() {
    let mut all = [0; 3];
    for seed in 0..12 {
        let reasons = check(like(1_000 + seed, 160, 26, 20, 150), 1 + seed as usize % 3);
        all = [0, 1, 2].map(|i| all[i] + reasons[i]);
    }
    assert!(all.iter().all(|count| *count > 100), "each reason is told: {all:?}");
}

#[test]
fn larger_scenes_are_searched_by_cells_and_as_a_whole() {
    check(like(7, 6_000, 90, 30, 20), 2);
    check(like(8, 6_001, 90, 2_000, 8), 3);
}

#[test]
fn steps_say_which_boxes_are_static_and_not_their_tags() {
    fn tags(tags: &[Tag]) -> Step<'_> {
        Step::Tag(Tags { indices: (0..2).into(), tags })
    }
    let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 2];
    let set = Step::Set(Sets { indices: (0..2).into(), boxes: &boxes });
    let (plain, of_static) = ([Tag::default(); 2], [Tag::default().with_static(true); 2]);
    let mut scene = Scene::new(options(10));
    let mut count = |steps: &[Step<'_>]| {
        scene.edit(Edit { steps }, Want::All).expect("an answer").pairs().len()
    };
    assert_eq!(count(&[set, tags(&of_static)]), 1);
    assert_eq!(count(&[Step::Static((0..2).into(), true)]), 0);
    assert_eq!(count(&[tags(&plain)]), 0, "as the step has said");
    assert_eq!(count(&[tags(&of_static), Step::Static((1..2).into(), false)]), 1);
}

#[test]
fn a_wrong_edit_of_rules_changes_nothing() {
    let mut scene = Scene::new(SceneOptions::default().with_most_boxes(10));
    let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 3];
    let set = Step::Set(Sets { indices: (0..3).into(), boxes: &boxes });
    scene.edit(Edit { steps: &[set] }, Want::Changes).expect("an answer");
    scene.take();
    let tags = [Tag::default().with_world(World(1)); 3];
    let tag = |indices, count: usize| Step::Tag(Tags { indices, tags: &tags[..count] });
    let wrong: [(&[Step<'_>], EditError); 6] = [
        (&[tag((0..3).into(), 2)], EditError::Lengths { indices: 3, boxes: 2 }),
        (&[tag((2..4).into(), 2)], EditError::Absent { index: 3 }),
        (&[tag((9..12).into(), 3)], EditError::BeyondLimit { index: 11, limit: 10 }),
        (&[Step::Include(&[[1, 10]], true)], EditError::BeyondLimit { index: 10, limit: 10 }),
        (&[Step::Remove((1..2).into()), tag((1..2).into(), 1)], EditError::Absent { index: 1 }),
        (&[tag((0..1).into(), 1), Step::Remove((5..6).into())], EditError::Absent { index: 5 }),
    ];
    for (steps, expected) in wrong {
        let refused = scene.edit(Edit { steps }, Want::Changes).map(drop);
        assert_eq!(refused, Err(SceneError::Edit(expected)), "{steps:?}");
        let told = scene.edit(Edit::NONE, Want::Changes).expect("an answer");
        assert!(told.begun().is_empty() && told.ended().is_empty(), "{steps:?}");
    }
}
