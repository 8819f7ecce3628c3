//! What `advise` prints of each kind, compiled. A test of `code` holds it to what is printed, and writes it where
//! `PAIRMASK_WRITE_PRINTED` is set.
#![allow(dead_code, unused_variables)]

use std::collections::HashSet;
use std::error::Error;
use std::sync::Arc;

use pairmask::filters::Rules;
use pairmask::{
    Aabb, Backend, Bounds, FrameOptions, Margin, Precision, Report, SceneOptions, Session, Sphere,
};

struct Program<'a> {
    boxes: &'a [Aabb],
    moved: &'a [u32],
    spheres: &'a [Sphere],
    rules: &'a Arc<Rules>,
    known: &'a mut HashSet<[u32; 2]>,
    meet: fn(u32, u32),
}

fn frame(program: Program<'_>) -> Result<(), Box<dyn Error>> {
    let Program { boxes, moved, spheres, rules, known, meet } = program;
    let mut session = Session::builder()
        .backend(Backend::InProcess)
        .connect()?;
    let mut frame = session.frame(boxes.len())?;
    frame.write(boxes)?;
    let mask = frame.submit()?.wait()?;
    for [a, b] in mask.pairs() {
        meet(a, b);
    }
    Ok(())
}

fn frame_of_gpu(program: Program<'_>) -> Result<(), Box<dyn Error>> {
    let Program { boxes, moved, spheres, rules, known, meet } = program;
    let mut session = Session::builder()
        .backend(Backend::Auto) // the daemon where one serves, else here
        .engine("gpu-grid".parse()?)
        .connect()?;
    let mut frame = session.frame(boxes.len())?;
    frame.write(boxes)?;
    let mask = frame.submit()?.wait()?;
    for [a, b] in mask.pairs() {
        meet(a, b);
    }
    Ok(())
}

fn narrow(program: Program<'_>) -> Result<(), Box<dyn Error>> {
    let Program { boxes, moved, spheres, rules, known, meet } = program;
    let mut session = Session::builder()
        .backend(Backend::Auto) // the daemon where one serves, else here
        .threads(1)
        .connect()?;
    let world = Bounds::around(boxes); // or those of your world
    let mut frame = session.narrow_frame(boxes.len(), Precision::Q16(world))?;
    frame.write(boxes)?;
    let mask = frame.submit()?.wait()?;
    for [a, b] in mask.pairs() {
        meet(a, b);
    }
    Ok(())
}

fn spheres(program: Program<'_>) -> Result<(), Box<dyn Error>> {
    let Program { boxes, moved, spheres, rules, known, meet } = program;
    let mut session = Session::builder()
        .backend(Backend::InProcess)
        .connect()?;
    let mut frame = session.sphere_frame(spheres.len())?;
    frame.spheres_mut().copy_from_slice(spheres);
    let mask = frame.submit()?.wait()?;
    for [a, b] in mask.pairs() {
        meet(a, b);
    }
    Ok(())
}

fn two_sets(program: Program<'_>) -> Result<(), Box<dyn Error>> {
    let Program { boxes, moved, spheres, rules, known, meet } = program;
    let mut session = Session::builder()
        .backend(Backend::InProcess)
        .connect()?;
    let mut frame = session.frame(boxes.len())?;
    frame.write(boxes)?;
    let options = FrameOptions { split_at: Some(1), ..Default::default() };
    let mask = frame.submit_with(&options)?.wait()?;
    for [a, b] in mask.pairs() {
        meet(a, b);
    }
    Ok(())
}

fn filters(program: Program<'_>) -> Result<(), Box<dyn Error>> {
    let Program { boxes, moved, spheres, rules, known, meet } = program;
    let mut session = Session::builder()
        .backend(Backend::InProcess)
        .connect()?;
    let mut frame = session.frame(boxes.len())?;
    frame.write(boxes)?;
    let filters = Some(Arc::clone(rules)); // the same while they stay
    let options = FrameOptions { filters, ..Default::default() };
    let mask = frame.submit_with(&options)?.wait()?;
    for [a, b] in mask.pairs() {
        meet(a, b);
    }
    Ok(())
}

fn narrow_filters(program: Program<'_>) -> Result<(), Box<dyn Error>> {
    let Program { boxes, moved, spheres, rules, known, meet } = program;
    let mut session = Session::builder()
        .backend(Backend::Auto) // the daemon where one serves, else here
        .connect()?;
    let world = Bounds::around(boxes); // or those of your world
    let mut frame = session.narrow_frame(boxes.len(), Precision::Q16(world))?;
    frame.write(boxes)?;
    let filters = Some(Arc::clone(rules)); // the same while they stay
    let options = FrameOptions { filters, ..Default::default() };
    let mask = frame.submit_with(&options)?.wait()?;
    for [a, b] in mask.pairs() {
        meet(a, b);
    }
    Ok(())
}

fn scene_pairs(program: Program<'_>) -> Result<(), Box<dyn Error>> {
    let Program { boxes, moved, spheres, rules, known, meet } = program;
    let mut session = Session::builder()
        .backend(Backend::InProcess)
        .connect()?;
    let options = SceneOptions::default();
    let mut scene = session.scene(options)?; // once
    let edit = scene.edit().set_with(moved, |i| boxes[i as usize]);
    let answer = edit.commit(Report::All)?;
    for [a, b] in answer.pairs() {
        meet(a, b);
    }
    Ok(())
}

fn scene_changes(program: Program<'_>) -> Result<(), Box<dyn Error>> {
    let Program { boxes, moved, spheres, rules, known, meet } = program;
    let mut session = Session::builder()
        .backend(Backend::InProcess)
        .threads(2)
        .connect()?;
    let options = SceneOptions::default();
    let mut scene = session.scene(options)?; // once
    let edit = scene.edit().set_with(moved, |i| boxes[i as usize]);
    let answer = edit.commit(Report::Changes)?;
    if answer.is_resync() {
        known.clear(); // all pairs come anew
    }
    // These first: an index may have another box now.
    for ended in answer.ended() {
        known.remove(&ended.pair);
    }
    known.extend(answer.begun());
    known.extend(answer.pairs());
    Ok(())
}

fn margin(program: Program<'_>) -> Result<(), Box<dyn Error>> {
    let Program { boxes, moved, spheres, rules, known, meet } = program;
    let mut session = Session::builder()
        .backend(Backend::InProcess)
        .connect()?;
    let options = SceneOptions::default()
        .with_margin(Margin::new(0.5)?);
    let mut scene = session.scene(options)?; // once
    let edit = scene.edit().set_with(moved, |i| boxes[i as usize]);
    let answer = edit.commit(Report::Changes)?;
    if answer.is_resync() {
        known.clear(); // all pairs come anew
    }
    // These first: an index may have another box now.
    for ended in answer.ended() {
        known.remove(&ended.pair);
    }
    known.extend(answer.begun());
    known.extend(answer.pairs());
    Ok(())
}

fn margin_near(program: Program<'_>) -> Result<(), Box<dyn Error>> {
    let Program { boxes, moved, spheres, rules, known, meet } = program;
    let mut session = Session::builder()
        .backend(Backend::InProcess)
        .connect()?;
    let options = SceneOptions::default()
        .with_margin(Margin::new(0.5)?)
        .with_near_pairs(true);
    let mut scene = session.scene(options)?; // once
    let edit = scene.edit().set_with(moved, |i| boxes[i as usize]);
    let answer = edit.commit(Report::All)?;
    for [a, b] in answer.pairs() {
        meet(a, b);
    }
    Ok(())
}

fn shared(program: Program<'_>) -> Result<(), Box<dyn Error>> {
    let Program { boxes, moved, spheres, rules, known, meet } = program;
    let mut session = Session::builder()
        .backend(Backend::Auto) // the daemon where one serves, else here
        .connect()?;
    let options = SceneOptions::default()
        .with_margin(Margin::new(0.5)?)
        .with_shared("world");
    let mut scene = session.scene(options)?; // once
    scene.lease(0..1000)?; // each writer its own indices
    let edit = scene.edit().set_with(moved, |i| boxes[i as usize]);
    let answer = edit.commit(Report::Changes)?;
    if answer.is_resync() {
        known.clear(); // all pairs come anew
    }
    // These first: an index may have another box now.
    for ended in answer.ended() {
        known.remove(&ended.pair);
    }
    known.extend(answer.begun());
    known.extend(answer.pairs());
    Ok(())
}
