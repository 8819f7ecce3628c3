//! Narrow forms: time to write and expand them, beside copying f32 boxes, on one thread.
//!
//! Least times of interleaved rounds, ns a box. `cargo bench -p pairmask-tests --bench precision`.
#![allow(clippy::unwrap_used, missing_docs)]

use std::hint::black_box;
use std::time::Instant;

use pairmask::{Backend, Session};
use pairmask_core::precision::{BoxSlice, ExpandScratch, Margin};
use pairmask_core::{Aabb, Bounds, BoxForm, Precision};
use pairmaskd::scene::{Scene, SceneName};

/// Boxes: few enough to stay on one thread, and in the second-level cache.
const BOXES: usize = 30_000;
/// Rounds of which the fastest counts.
const ROUNDS: usize = 300;

fn main() {
    let scene = Scene::new(SceneName::Uniform, BOXES, 1);
    let boxes = scene.boxes();
    let bounds = Bounds::around(boxes);
    let mut session = Session::builder().backend(Backend::InProcess).connect().unwrap();
    let mut scratch = ExpandScratch::default();
    let mut copy = vec![Aabb::default(); BOXES];
    let margin = Margin::new(0.1).unwrap();
    let mut least: Vec<(String, f64)> = Vec::new();
    let mut time = |name: String, work: &mut dyn FnMut()| {
        let start = Instant::now();
        work();
        let ns = start.elapsed().as_nanos() as f64 / BOXES as f64;
        match least.iter_mut().find(|(known, _)| *known == name) {
            Some((_, least)) => *least = least.min(ns),
            None => least.push((name, ns)),
        }
    };
    for _ in 0..ROUNDS {
        time("copy f32".to_owned(), &mut || black_box(&mut copy).copy_from_slice(boxes));
        time("inflate".to_owned(), &mut || {
            for (out, b) in black_box(&mut copy).iter_mut().zip(boxes) {
                *out = margin.inflate(b);
            }
        });
        for precision in [Precision::Q16(bounds), Precision::Q8(bounds), Precision::F16] {
            let form = precision.form();
            let mut words = vec![0u32; BOXES * form.box_bytes() / 4];
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut words);
            time(format!("write {form}"), &mut || precision.write(boxes, black_box(bytes)));
            time(format!("expand {form}"), &mut || {
                let view = BoxSlice::new(form, black_box(bytes)).unwrap();
                black_box(view.expand(&mut scratch, false));
            });
        }
        let mut frame = session.narrow_frame(BOXES, Precision::Q16(bounds)).unwrap();
        time("in-process q16".to_owned(), &mut || frame.fill(boxes));
    }
    assert_eq!(BoxForm::ALL.len(), 4, "every narrow form is measured");
    for (name, ns) in least {
        println!("{name:<16} {ns:6.2} ns a box");
    }
}
