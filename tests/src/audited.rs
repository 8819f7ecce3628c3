//! A daemon whose auditor checks every frame, and its report on some frames.

use pairmask::{Backend, Session};
use pairmask_core::{Aabb, Encoding, EncodingChoice, Sphere};
use pairmask_transport::RuntimeDir;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::command_line::{Place, Program, eventually, finish};

/// The objects of frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Boxes.
    Boxes,
    /// Spheres.
    Spheres,
}

/// The auditor's counts by `status --json` after five frames of 40 objects that all overlap, and
/// the daemon's log.
///
/// # Panics
/// Where the daemon does not start, answer or stop.
pub fn audit<P: Program>(encoding: Encoding, shape: Shape) -> (Value, String) {
    let place = Place::<P>::new();
    let child = place.command(&["serve", "--audit", "1/1"]).spawn().expect("the daemon starts");
    let dir = RuntimeDir::at(place.path());
    let name = "default".parse().expect("a name");
    eventually("the daemon serves", || dir.read_record(&name));
    let builder = Session::builder().runtime_dir(dir).backend(Backend::Daemon);
    let session = builder.encoding(EncodingChoice::Only(encoding)).connect();
    let mut session = session.expect("the daemon answers");
    for _ in 0..5 {
        let pending = match shape {
            Shape::Boxes => {
                let mut frame = session.frame(40).expect("memory for a frame");
                frame.boxes_mut().fill(Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]));
                frame.submit()
            }
            Shape::Spheres => {
                let mut frame = session.sphere_frame(40).expect("memory for a frame");
                frame.spheres_mut().fill(Sphere::new([0.0; 3], 1.0));
                frame.submit()
            }
        };
        pending.expect("a frame is sent").wait().expect("a frame is answered");
    }
    let report = eventually("frames are checked", || {
        let report = place.run(&["status", "--json"]).json();
        let told = report["instances"][0]["daemon"]["audit"].clone();
        let count = |field: &str| told[field].as_u64().expect("a count");
        (count("frames") > 0 && count("frames") + count("skipped") == 5).then_some(told)
    });
    let text = place.run(&["status"]).stdout;
    let pid = Pid::from_raw(child.id().cast_signed()).expect("not zero");
    kill_process(pid, Signal::TERM).expect("the daemon lives");
    let finished = finish(child, P::NAME);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    assert!(text.contains("audit of 1/1: "), "{text}");
    (report, finished.stderr)
}
