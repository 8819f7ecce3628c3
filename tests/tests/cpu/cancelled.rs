//! Work whose answer nobody waits for any more: it ends at whichever look finds so, and leaves its memory fit for the next.

use pairmask_core::cast::{Hit, Hits, Ray, Shapes};
use pairmask_core::dispatch::SphereEngines;
use pairmask_core::filters::{FilterData, Owner, Rules, World};
use pairmask_core::scene::{Cast, QueryError, Reported, Scene, cull_between};
use pairmask_tests::cancelled::{Looks, cancel_at_each_look, words_of};
use pairmask_tests::prelude::*;
use pairmaskd::scene::{Scene as Drawn, SceneName};

fn scene(name: SceneName, n: usize) -> Vec<Aabb> {
    Drawn::new(name, n, 7).boxes().to_vec()
}

#[test]
fn engines_end_at_any_look_and_serve_the_next_frame() {
    let scenes = [
        scene(SceneName::Uniform, 60_000),
        scene(SceneName::Mixed, 20_000),
        // In a row, and some that overlap nothing.
        (0..30_000).map(|i| if i % 7 == 0 { Aabb::EMPTY } else { at(i as f32 * 0.3) }).collect(),
    ];
    for name in EngineName::CPU {
        let mut engine = best_engine(name);
        for (number, boxes) in scenes.iter().enumerate() {
            let boxes = &boxes[..if name == EngineName::CpuBrute { 12_000 } else { boxes.len() }];
            for encoding in name.descriptor().encodings {
                // All bits of 60,000 boxes are 225 MB.
                let few = 12_000.min(boxes.len());
                let boxes = if *encoding == Encoding::Dense { &boxes[..few] } else { boxes };
                for threads in [1, 2] {
                    let what = format!("{name}, {encoding}, scene {number}, {threads} threads");
                    let looks = pool(threads).install(|| {
                        cancel_at_each_look(&what, |reply| {
                            let input =
                                CullInput::boxes(boxes).encoding(*encoding).threads(threads);
                            let report = engine.cull(&input, reply)?;
                            Ok(words_of(&report, reply))
                        })
                    });
                    assert!(looks > 3, "{what}: {looks} looks");
                }
            }
        }
    }
}

#[test]
fn small_frames_are_not_looked_at() {
    let boxes = scene(SceneName::Uniform, 1_000);
    for name in EngineName::CPU {
        let looks = cancel_at_each_look(name.as_str(), |reply| {
            let report = best_engine(name).cull(&CullInput::boxes(&boxes), reply)?;
            Ok(words_of(&report, reply))
        });
        assert!(looks <= 8, "{name}: {looks} looks of a frame of some µs");
    }
}

#[test]
fn frames_that_are_planned_end_and_teach_nothing() {
    let boxes = scene(SceneName::Uniform, 60_000);
    let mut engines = CpuEngines::new();
    let options = CullOptions { threads: Some(1), ..CullOptions::default() };
    cancel_at_each_look("planned", |reply| {
        let answer = engines.cull(&boxes, &options, reply)?;
        // The engine is the plan's choice, and with it the order.
        let n = BoxCount::new(60_000);
        let mask = MaskView::new(n, &answer.report.shape, reply.words()).expect("a good mask");
        let mut pairs = mask.to_vec();
        pairs.sort_unstable();
        Ok(pairs.into_flattened())
    });
    let mut first = CpuEngines::new();
    let plan = |engines: &mut CpuEngines| engines.plan(&boxes, &options, None).engine;
    let expected = plan(&mut first);
    for _ in 0..200 {
        let mut reply = HeapReply::new();
        reply.set_asker(Some(Looks::left(2)));
        assert_eq!(first.cull(&boxes, &options, &mut reply).err(), Some(CullError::Cancelled));
    }
    assert_eq!(plan(&mut first), expected);
}

#[test]
fn spheres_sets_and_filters_end_at_any_look() {
    let boxes = scene(SceneName::Uniform, 40_000);
    let spheres: Vec<Sphere> =
        boxes.iter().map(|b| Sphere::new(b.min, 0.5 * (b.max[0] - b.min[0]))).collect();
    for (engine, n) in [(EngineName::CpuGrid, 40_000), (EngineName::CpuBrute, 6_000)] {
        let mut engines = SphereEngines::new();
        let engine = EngineChoice::Only(engine);
        let options = CullOptions { engine, threads: Some(1), ..CullOptions::default() };
        let looks = cancel_at_each_look("spheres", |reply| {
            let answer = engines.cull(&spheres[..n], &options, reply)?;
            Ok(words_of(&answer.report, reply))
        });
        assert!(looks > 3, "{looks} looks");
    }
    for first in [500, 20_000] {
        let mut engines = CpuEngines::new();
        let options = CullOptions { threads: Some(1), ..CullOptions::default() };
        let looks = cancel_at_each_look("sets", |reply| {
            let first = BoxCount::new(first);
            let answer = cull_between(&mut engines, &boxes, first, &options, reply)?;
            Ok(words_of(&answer.report, reply))
        });
        assert!(looks > 3, "{looks} looks");
    }
    let filter_data =
        |of: &dyn Fn(u32) -> FilterData| -> Vec<FilterData> { (0..40_000).map(of).collect() };
    let owners = filter_data(&|i| FilterData::default().with_owner(Owner(i / 3)));
    let worlds = filter_data(&|i| FilterData::default().with_world(World((i % 4) as i32)));
    for (what, filter_data) in [("owners", owners), ("worlds", worlds)] {
        let mut rules = Rules::default();
        rules.filter_data = filter_data;
        let mut engines = CpuEngines::new();
        let options = CullOptions { threads: Some(1), ..CullOptions::default() };
        let looks = cancel_at_each_look(what, |reply| {
            let answer = engines.cull_filtered(&boxes, &rules, &options, reply)?.answer;
            Ok(words_of(&answer.report, reply))
        });
        assert!(looks > 3, "{what}: {looks} looks");
    }
}

/// A scene with an edit of a few boxes, and one of all.
fn edits(n: u32) -> (Vec<Aabb>, Vec<Aabb>) {
    let boxes = scene(SceneName::Uniform, n as usize);
    let moved = boxes.iter().map(|b| Aabb::new(b.min, b.max.map(|x| x + 0.5))).collect();
    (boxes, moved)
}

#[test]
fn edits_end_at_any_look_and_the_scene_is_made_anew() {
    let (boxes, moved) = edits(40_000);
    for (few, report) in [
        (2_000, Report::Changes),
        (2_000, Report::Moved),
        (40_000, Report::Changes),
        (40_000, Report::All),
    ] {
        let made = || {
            let mut scene = Scene::new(SceneOptions::default().with_threads(1));
            let all = [sets(0..40_000, &boxes)];
            let (there, back) =
                ([sets(0..few as u32, &moved[..few])], [sets(0..few as u32, &boxes[..few])]);
            // The second small edit makes cells.
            for steps in [&all, &there, &back, &there, &back] {
                scene.edit(Edit { steps }, Report::Changes).expect("an answer");
                scene.acknowledge();
            }
            scene
        };
        let steps = [sets(0..few as u32, &moved[..few])];
        let answer = |scene: &mut Scene| -> Result<Reported, SceneError> {
            Ok(scene.edit(Edit { steps: &steps }, report)?.clone())
        };
        let looks = Looks::left(u64::MAX);
        let mut whole = made();
        whole.set_asker(Some(looks.clone()));
        let expected = answer(&mut whole).expect("an answer");
        let all = looks.seen();
        let what = format!("{few} boxes, {report:?}");
        assert!(all > 0, "{what}");
        for left in (0..all).step_by(all.div_ceil(4) as usize) {
            let mut scene = made();
            scene.set_asker(Some(Looks::left(left)));
            let cancelled = SceneError::Cull(CullError::Cancelled);
            assert_eq!(answer(&mut scene).err(), Some(cancelled), "{what}: look {left} of {all}");
            // It is dropped, and another one is made by the same edits.
            let again = answer(&mut made()).expect("an answer");
            assert_eq!(again.begun(), expected.begun(), "{what}");
            assert_eq!(again.ended(), expected.ended(), "{what}");
            assert_eq!(again.pairs(), expected.pairs(), "{what}");
        }
    }
}

/// What is asked of a scene, and its answer as bytes.
type Ask<'a> = &'a dyn Fn(&mut Scene) -> Result<Vec<u8>, QueryError>;

#[test]
fn queries_and_casts_end_at_any_look_and_change_nothing() {
    let (boxes, queries) = edits(40_000);
    let mut scene = Scene::new(SceneOptions::default().with_threads(1));
    scene.edit(Edit { steps: &[sets(0..40_000, &boxes)] }, Report::Nothing).expect("an answer");
    let rays: Vec<Ray> = queries.iter().map(|b| Ray::new(b.min, [1.0, 0.5, 0.25])).collect();
    let cast = |scene: &mut Scene, rays: &[Ray], found: &mut Vec<Hit>| {
        let cast = Cast {
            shapes: Shapes::Rays(rays),
            hits: Hits::Closest(2),
            filter_data: QueryFilterData::None,
            most_hits: 1 << 20,
        };
        scene.cast(&cast, found).map(|_| ())
    };
    let query = |scene: &mut Scene, count: usize| {
        let mut found = Vec::new();
        scene.query(&queries[..count], QueryFilterData::None, &mut found)?;
        Ok(bytemuck::cast_slice(&found).to_vec())
    };
    let hits = |scene: &mut Scene| {
        let mut found = Vec::new();
        cast(scene, &rays[..2_000], &mut found)?;
        Ok(bytemuck::cast_slice(&found).to_vec())
    };
    let asked: [(&str, Ask<'_>); 3] = [
        ("few queries", &|scene| query(scene, 40)),
        ("queries", &|scene| query(scene, 40_000)),
        ("rays", &hits),
    ];
    for (what, ask) in asked {
        // The first looks are those of the building of cells or trees.
        for left in [0, 1, 2, 5, 20] {
            scene.set_asker(Some(Looks::left(left)));
            let ended = ask(&mut scene);
            scene.set_asker(None);
            let whole = ask(&mut scene).expect("an answer");
            match ended {
                Err(QueryError::Cull(CullError::Cancelled)) => {}
                Ok(found) => assert!(left > 0 && found == whole, "{what}, look {left}"),
                Err(error) => panic!("{what}: {error}"),
            }
            let mut fresh = Scene::new(SceneOptions::default().with_threads(1));
            fresh
                .edit(Edit { steps: &[sets(0..40_000, &boxes)] }, Report::Nothing)
                .expect("an answer");
            assert!(ask(&mut fresh).expect("an answer") == whole, "{what}, after look {left}");
        }
    }
    let moved = [sets(0..2_000, &queries[..2_000])];
    let report = |scene: &mut Scene| {
        scene.edit(Edit { steps: &moved }, Report::All).expect("an answer").pairs().to_vec()
    };
    let mut fresh = Scene::new(SceneOptions::default().with_threads(1));
    fresh.edit(Edit { steps: &[sets(0..40_000, &boxes)] }, Report::Nothing).expect("an answer");
    assert!(report(&mut scene) == report(&mut fresh), "an edit after them");
}
