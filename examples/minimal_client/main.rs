//! The smallest client: four boxes in, the overlapping pairs out.

use std::process::ExitCode;

use pairmask::{Aabb, Session};

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Error texts are for users: each says what is wrong and what to do.
            eprintln!("minimal_client: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    // By default the session uses the daemon if one answers, else this process.
    let mut session = Session::builder().connect()?;

    // The frame lies in shared memory where a daemon serves: the boxes are written in place.
    let mut frame = session.frame(4)?;
    let boxes = frame.boxes_mut();
    boxes[0] = Aabb::new([0.0; 3], [1.0; 3]);
    boxes[1] = Aabb::new([0.5; 3], [1.5; 3]);
    boxes[2] = Aabb::new([1.0, 0.0, 0.0], [2.0, 1.0, 1.0]);
    boxes[3] = Aabb::new([8.0; 3], [9.0; 3]);

    let mask = frame.submit()?.wait()?;
    println!("served by: {:?}", mask.info().served_by);
    for [a, b] in mask.pairs() {
        println!("boxes {a} and {b} overlap");
    }
    Ok(())
}
