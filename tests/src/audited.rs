//! A daemon whose auditor checks every frame, and its report on some frames.

use pairmask::{Backend, SceneOptions, Session};
use pairmask_core::scene::Report;
use pairmask_core::{Aabb, Encoding, EncodingChoice, Sphere};
use pairmask_transport::RuntimeDir;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::command_line::{Program, Sandbox, eventually, finish};
use crate::frames::two_sets;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    Boxes,
    Spheres,
    Sets,
    /// Queries of a scene. Its one edit is a frame beside them.
    Queries,
}

const OBJECTS: usize = 40;
const FIRST: usize = 10;

/// The auditor's counts by `status --json` after five frames of 40 objects that all overlap, or queries of so many,
/// and the daemon's log.
pub fn audit<P: Program>(encoding: Encoding, shape: Shape) -> (Value, String) {
    let sandbox = Sandbox::<P>::new();
    let child = sandbox.command(&["serve", "--audit", "1/1"]).spawn().expect("the daemon starts");
    let dir = RuntimeDir::at(sandbox.path());
    let name = "default".parse().expect("a name");
    eventually("the daemon serves", || dir.read_record(&name));
    let builder = Session::builder().runtime_dir(dir).backend(Backend::Daemon);
    let session = builder.encoding(EncodingChoice::Only(encoding)).connect();
    let mut session = session.expect("the daemon answers");
    let boxes = [Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]); OBJECTS];
    let mut scene = (shape == Shape::Queries)
        .then(|| session.scene(SceneOptions::default()).expect("no other process is needed"));
    if let Some(scene) = &mut scene {
        let edit = scene.edit().set_all(0..(OBJECTS - FIRST) as u32, &boxes[FIRST..]);
        drop(edit.commit(Report::Nothing).expect("an edit is answered"));
    }
    for _ in 0..5 {
        if let Some(scene) = &mut scene {
            drop(scene.query(&boxes[..FIRST]).expect("a query is answered"));
            continue;
        }
        let pending = if shape == Shape::Spheres {
            let mut frame = session.sphere_frame(OBJECTS).expect("memory for a frame");
            frame.spheres_mut().fill(Sphere::new([0.0; 3], 1.0));
            frame.submit()
        } else {
            let mut frame = session.frame(OBJECTS).expect("memory for a frame");
            frame.write(&boxes).expect("as many boxes as asked for");
            match shape {
                Shape::Sets => frame.submit_with(&two_sets(FIRST)),
                _ => frame.submit(),
            }
        };
        pending.expect("a frame is sent").wait().expect("a frame is answered");
    }
    let frames = 5 + u64::from(scene.is_some());
    let report = eventually("frames are checked", || {
        let report = sandbox.run(&["status", "--json"]).json();
        let reported = report["instances"][0]["daemon"]["audit"].clone();
        let count = |field: &str| reported[field].as_u64().expect("a count");
        (count("frames") > 0 && count("frames") + count("skipped") == frames).then_some(reported)
    });
    let text = sandbox.run(&["status"]).stdout;
    let pid = Pid::from_raw(child.id().cast_signed()).expect("not zero");
    kill_process(pid, Signal::TERM).expect("the daemon lives");
    let finished = finish(child, P::NAME);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    assert!(text.contains("audit of 1/1: "), "{text}");
    (report, finished.stderr)
}
