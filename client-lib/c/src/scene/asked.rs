//! What a scene is asked: which boxes some other boxes overlap, rays hit, or are nearest to points.

use bytemuck::cast_slice;
use pairmask::cast::{Hits, Shapes};
use pairmask::filters::QueryFilterData;

use super::pm_scene;
use crate::code::pm_code;
use crate::failure::Failure;
use crate::handles::Handle;
use crate::memory::{In, Out, raw};
use crate::values::{
    PM_HITS_ALL, PM_HITS_ANY, PM_HITS_CLOSEST, pm_box, pm_filter_data, pm_hit, pm_hits, pm_pair,
    pm_ray, pm_sphere, to_pairs,
};

fn filter_data_of(given: &[pm_filter_data]) -> QueryFilterData<'_> {
    match cast_slice(given) {
        [] => QueryFilterData::None,
        [filter_data] => QueryFilterData::One(*filter_data),
        filter_data => QueryFilterData::Each(filter_data),
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_query(
    scene: pm_scene,
    boxes: In<pm_box>,
    n: usize,
    filter_data: In<pm_filter_data>,
    filter_data_count: usize,
    found: Out<*const pm_pair>,
    count: Out<usize>,
) -> pm_code {
    found.give_list(count, || {
        let (boxes, filter_data) =
            (cast_slice(boxes.array(n)?), filter_data_of(filter_data.array(filter_data_count)?));
        scene.with(|scene| {
            let answer = scene.state.end()?.scene.query_filtered(boxes, filter_data)?;
            scene.found.clear();
            answer.for_each_slice(|pairs| scene.found.extend_from_slice(pairs));
            Ok(raw(to_pairs(&scene.found)))
        })
    })
}

/// What a cast has found, as a program sees it.
fn cast(
    scene: pm_scene,
    shapes: Shapes<'_>,
    (hits, most): (pm_hits, u32),
    filter_data: &[pm_filter_data],
) -> Result<(*const pm_hit, usize), Failure> {
    let hits = match hits {
        PM_HITS_ALL => Hits::All,
        PM_HITS_CLOSEST => Hits::Closest(most),
        PM_HITS_ANY => Hits::Any,
        _ => return Err(Failure::argument("no such hits")),
    };
    scene.with(|scene| {
        let filter_data = filter_data_of(filter_data);
        let answer = scene.state.end()?.scene.cast_filtered(shapes, hits, filter_data)?;
        scene.hits.clear();
        scene.hits.extend_from_slice(answer.hits());
        Ok(raw(cast_slice(&scene.hits)))
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_cast(
    scene: pm_scene,
    rays: In<pm_ray>,
    n: usize,
    hits: pm_hits,
    most: u32,
    filter_data: In<pm_filter_data>,
    filter_data_count: usize,
    found: Out<*const pm_hit>,
    count: Out<usize>,
) -> pm_code {
    found.give_list(count, || {
        let rays = Shapes::Rays(cast_slice(rays.array(n)?));
        cast(scene, rays, (hits, most), filter_data.array(filter_data_count)?)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_nearest(
    scene: pm_scene,
    spheres: In<pm_sphere>,
    n: usize,
    hits: pm_hits,
    most: u32,
    filter_data: In<pm_filter_data>,
    filter_data_count: usize,
    found: Out<*const pm_hit>,
    count: Out<usize>,
) -> pm_code {
    found.give_list(count, || {
        let spheres = Shapes::Spheres(cast_slice(spheres.array(n)?));
        cast(scene, spheres, (hits, most), filter_data.array(filter_data_count)?)
    })
}
