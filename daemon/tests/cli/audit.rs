//! `serve --audit`: frames are checked again, and a broken engine is counted in `status`.

use pairmask::transport::RuntimeDir;
use pairmask::{Aabb, Backend, Encoding, EncodingChoice, Session, Sphere};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::support::{Place, eventually, finish};

/// What frames are made of.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    Boxes,
    Spheres,
}

/// What `status` says of the auditor after some frames of 40 objects that all overlap.
fn audit(more: &[&str], encoding: Encoding, shape: Shape) -> (Value, String) {
    let place = Place::new();
    let child = place.command(&[&["serve", "--audit", "1/1"], more].concat()).spawn().unwrap();
    let dir = RuntimeDir::at(place.path());
    eventually("the daemon serves", || dir.read_record(&"default".parse().unwrap()));
    let builder = Session::builder().runtime_dir(dir).backend(Backend::Daemon);
    let mut session = builder.encoding(EncodingChoice::Only(encoding)).connect().unwrap();
    for _ in 0..5 {
        let pending = match shape {
            Shape::Boxes => {
                let mut frame = session.frame(40).unwrap();
                frame.boxes_mut().fill(Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]));
                frame.submit().unwrap()
            }
            Shape::Spheres => {
                let mut frame = session.sphere_frame(40).unwrap();
                frame.spheres_mut().fill(Sphere::new([0.0; 3], 1.0));
                frame.submit().unwrap()
            }
        };
        pending.wait().unwrap();
    }
    let report = eventually("frames are checked", || {
        let report = place.run(&["status", "--json"]).json();
        let told = report["instances"][0]["daemon"]["audit"].clone();
        let count = |field: &str| told[field].as_u64().unwrap();
        (count("frames") > 0 && count("frames") + count("skipped") == 5).then_some(told)
    });
    let text = place.run(&["status"]).stdout;
    kill_process(Pid::from_raw(child.id().cast_signed()).unwrap(), Signal::TERM).unwrap();
    let finished = finish(child);
    assert_eq!(finished.code, Some(0), "{finished:?}");
    assert!(text.contains("audit of 1/1: "), "{text}");
    (report, finished.stderr)
}

#[test]
fn right_frames_pass() {
    for shape in [Shape::Boxes, Shape::Spheres] {
        let (told, log) = audit(&[], Encoding::Sparse, shape);
        assert_eq!((&told["missed"], &told["extra"]), (&0.into(), &0.into()), "{told}");
        assert_eq!(told["pairs"].as_u64().unwrap(), told["frames"].as_u64().unwrap() * 780);
        assert_eq!(told["one_in"], 1);
        assert!(!log.contains("audit"), "{log}");
    }
}

#[test]
fn a_broken_engine_is_counted() {
    for (encoding, shape) in [
        (Encoding::Dense, Shape::Boxes),
        (Encoding::Sparse, Shape::Boxes),
        (Encoding::Sparse, Shape::Spheres),
    ] {
        let (told, log) = audit(&["--break-engine"], encoding, shape);
        assert_eq!(told["missed"], told["frames"], "a pair is lost in every frame: {told}");
        assert_eq!(told["extra"], 0);
        assert!(log.contains("1 missed and 0 extra pairs"), "{log}");
    }
}

#[test]
fn a_rate_that_is_none_is_refused() {
    assert_eq!(Place::new().run(&["serve", "--audit", "often"]).code, Some(2));
}
