//! The Rust side of `overhead.py`: the same frames, timed the same way, whenever a line comes.
//!
//! Arguments: a file of boxes (24 bytes each), the backend, a runtime directory (`-` for none) and how many
//! frames a turn has. For each line of input one line of output: the median time of a frame, nanoseconds.

use std::env;
use std::fs;
use std::hint::black_box;
use std::io::{BufRead, Write, stdin, stdout};
use std::time::Instant;

use pairmask::{Aabb, Session};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Cargo adds `--bench`.
    let arguments: Vec<String> = env::args().skip(1).filter(|given| given != "--bench").collect();
    let [file, backend, dir, frames] = &arguments[..] else {
        return Err("rust_frame FILE BACKEND DIR FRAMES: overhead.py runs it".into());
    };
    let bytes = fs::read(file)?;
    let boxes: Vec<Aabb> =
        bytes.chunks_exact(size_of::<Aabb>()).map(bytemuck::pod_read_unaligned).collect();
    let frames: usize = frames.parse()?;
    let mut builder = Session::builder().backend(backend.parse()?).threads(1).answer_repeats(false);
    if dir != "-" {
        builder = builder.runtime_dir(std::path::PathBuf::from(dir));
    }
    let mut session = builder.connect()?;
    let mut times = Vec::with_capacity(frames);
    for line in stdin().lock().lines() {
        line?;
        times.clear();
        for _ in 0..frames {
            let begun = Instant::now();
            let mut frame = session.frame(boxes.len())?;
            frame.write(&boxes)?;
            let mask = frame.submit()?.wait()?;
            let mut pairs = Vec::with_capacity(mask.count() as usize);
            mask.for_each_slice(|some| pairs.extend_from_slice(some));
            black_box(&pairs);
            drop((mask, pairs));
            times.push(begun.elapsed().as_nanos());
        }
        times.sort_unstable();
        println!("{}", times[times.len() / 2]);
        stdout().flush()?;
    }
    Ok(())
}
