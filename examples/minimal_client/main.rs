//! The smallest client: four boxes in, the overlapping pairs out.

use std::process::ExitCode;

use pairmask::glam::Vec3;
use pairmask::{Aabb, Session};

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Errors are written to be read: each says what is wrong and what to do.
            eprintln!("minimal_client: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    // With nothing said, the session takes the daemon where one answers, else this process.
    let mut session = Session::builder().connect()?;

    // The frame lies in shared memory where a daemon serves: the boxes are written in place.
    let mut frame = session.frame(4)?;
    let boxes = frame.boxes_mut();
    boxes[0] = Aabb::new(Vec3::ZERO, Vec3::ONE);
    boxes[1] = Aabb::new(Vec3::splat(0.5), Vec3::splat(1.5));
    boxes[2] = Aabb::new(Vec3::new(1.0, 0.0, 0.0), Vec3::new(2.0, 1.0, 1.0));
    boxes[3] = Aabb::new(Vec3::splat(8.0), Vec3::splat(9.0));

    let mask = frame.submit()?.wait()?;
    println!("served by: {:?}", mask.info().served_by);
    for (a, b) in mask.pairs() {
        println!("boxes {a} and {b} overlap");
    }
    Ok(())
}
