//! Work on a GPU whose answer nobody waits for any more: it ends between two submissions, and the next is served.

use pairmask::cast::{Hits, Ray, Shapes};
use pairmask_core::scene::{Cast, QueryError, SceneError};
use pairmask_tests::cancelled::{Looks, cancel_at_each_look, words_of};
use pairmask_tests::gpu::{open, scene_tools};
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::{AllPairs, EngineOptions, GpuScene, Grid, HostImport};

#[test]
fn frames_of_all_pairs_end_between_submissions() {
    let gpu = open(HostImport::IfPossible);
    let mut engine = AllPairs::new(&gpu, EngineOptions::default()).unwrap();
    let boxes = stress_scenes::named("uniform").boxes(40_000, 3);
    let looks = cancel_at_each_look("all pairs", |reply| {
        let input = CullInput::boxes(&boxes).encoding(Encoding::Sparse);
        let report = engine.cull(&input, reply)?;
        Ok(words_of(&report, reply))
    });
    assert!(looks > 0);
}

#[test]
fn a_frame_of_the_grid_ends_before_its_second_submission() {
    let gpu = open(HostImport::IfPossible);
    // More words than a grid's frame has room for at first.
    let crowd = vec![at(0.0); 3_000];
    let input = CullInput::boxes(&crowd).encoding(Encoding::Sparse);
    let mut grid = Grid::new(&gpu, &EngineOptions::default()).unwrap();
    let mut reply = HeapReply::new();
    reply.set_asker(Some(Looks::left(0)));
    assert_eq!(grid.cull(&input, &mut reply).err(), Some(CullError::Cancelled));
    reply.set_asker(None);
    assert_eq!(grid.cull(&input, &mut reply).unwrap().pair_count, 3_000 * 2_999 / 2);
}

/// What is asked of a scene.
type Ask<'a> = &'a dyn Fn(&mut GpuScene) -> Result<Vec<u32>, QueryError>;

#[test]
fn scenes_end_between_submissions() {
    let tools = scene_tools(0, &EngineOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(6_000, 3);
    let moved: Vec<Aabb> = boxes.iter().map(|b| Aabb::new(b.min, b.max.map(|x| x + 0.1))).collect();
    let mut scene = GpuScene::new(&tools, SceneOptions::default());
    scene.edit(Edit { steps: &sets_all(&boxes) }, Report::Nothing).unwrap();
    let rays: Vec<Ray> = boxes.iter().map(|b| Ray::new(b.min, [1.0, 0.5, 0.25])).collect();
    let cast = |scene: &mut GpuScene| {
        let cast = Cast {
            shapes: Shapes::Rays(&rays),
            hits: Hits::All,
            filter_data: QueryFilterData::None,
            most_hits: 1 << 20,
        };
        let mut found = Vec::new();
        scene.cast(&cast, &mut found).map(|_| bytemuck::cast_slice(&found).to_vec())
    };
    let query = |scene: &mut GpuScene| {
        let mut found = Vec::new();
        scene.query(&moved, QueryFilterData::None, &mut found)?;
        Ok(found.into_flattened())
    };
    let all: [(&str, Ask<'_>); 2] = [("cast", &cast), ("query", &query)];
    for (what, ask) in all {
        let looks = Looks::left(u64::MAX);
        scene.set_asker(Some(looks.clone()));
        let expected = ask(&mut scene).unwrap();
        assert!(looks.seen() > 0, "{what}");
        for left in (0..looks.seen()).step_by(5) {
            scene.set_asker(Some(Looks::left(left)));
            let cancelled = QueryError::Cull(CullError::Cancelled);
            assert_eq!(ask(&mut scene).err(), Some(cancelled), "{what}, look {left}");
            scene.set_asker(None);
            assert!(ask(&mut scene).unwrap() == expected, "{what}, after look {left}");
        }
    }
    let looks = Looks::left(u64::MAX);
    scene.set_asker(Some(looks.clone()));
    let steps = sets_all(&moved);
    scene.edit(Edit { steps: &steps }, Report::All).unwrap();
    assert!(looks.seen() > 0);
    for left in 0..looks.seen() {
        // One that was cancelled is dropped.
        let mut scene = GpuScene::new(&tools, SceneOptions::default());
        scene.edit(Edit { steps: &sets_all(&boxes) }, Report::Nothing).unwrap();
        scene.set_asker(Some(Looks::left(left)));
        let cancelled = SceneError::Cull(CullError::Cancelled);
        let edited = scene.edit(Edit { steps: &steps }, Report::All);
        assert_eq!(edited.err(), Some(cancelled), "look {left}");
    }
}
