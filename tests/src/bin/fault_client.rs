//! A client that fails on purpose. `fault_client MODE [ENGINE]`, with the daemon's directory in
//! `PAIRMASK_RUNTIME_DIR`. It has one frame answered, prints `connected`, waits for a line, causes its
//! fault, prints `ready`, and sleeps until it is killed.
//!
//! * `loan` holds a half-filled frame;
//! * `pending` has two frames under way and never takes their answers;
//! * `load` submits small frames one after the other, and takes their answers;
//! * `shared` writes ten boxes of the shared scene that its third argument names, tick by tick;
//! * `greedy` always has as many large frames waiting as it may;
//! * `pile` submits a frame of boxes in one place, which takes long, and prints `answered` once it has its answer;
//! * `long` waits for a frame that takes `cpu-brute` minutes;
//! * `truncate` cuts its own segment short while the daemon (stopped by the test) has a request;
//!
//! * `right` compares its answers with the oracle, until its input ends: it says `wrong` where one is not right, and at
//!   the end how many were.
//!
//! Three modes print what they find and end:
//!
//! * `full` fills larger and larger frames until the memory runs out, `full-spheres` such of spheres;
//! * `connect` reports how the attempt to connect went, and has a frame answered.

use std::collections::VecDeque;
use std::error::Error;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::time::Duration;

use pairmask::{Backend, PairMask, Pending, Report, SceneOptions, Session};
use pairmask_core::{Aabb, EngineChoice, Sphere};
use pairmask_tests::frames::{Frames, Sorted, at};
use pairmask_tests::{oracle, stress_scenes};
use pairmask_transport::FRAMES_AT_A_TIME;

fn main() -> Result<(), Box<dyn Error>> {
    let mode = std::env::args().nth(1).unwrap_or_default();
    let engine = std::env::args().nth(2).map_or(Ok(EngineChoice::Auto), |name| name.parse())?;
    let backend = if mode == "right" { Backend::Auto } else { Backend::Daemon };
    let connected = Session::builder().backend(backend).engine(engine).connect();
    if mode == "connect" {
        match connected {
            Ok(mut session) => {
                session.ask(&[Aabb::EMPTY; 10]).wait()?;
                println!("connected");
            }
            Err(error) => println!("{error:?}"),
        }
        return Ok(());
    }
    let mut session = connected?;
    if mode == "full" || mode == "full-spheres" {
        let fill = if mode == "full" { fill_boxes } else { fill_spheres };
        println!("{}", fill_up(&mut session, fill));
        return Ok(());
    }
    session.ask(&[Aabb::EMPTY; 10]).wait()?;
    println!("connected");
    std::io::stdin().read_line(&mut String::new())?;
    let mut held = Vec::new();
    match mode.as_str() {
        "loan" => {
            let mut frame = session.frame(50_000)?;
            frame.boxes_mut()[..25_000].fill(Aabb::new([0.0; 3], [1.0; 3]));
            return ready(frame);
        }
        "pending" => {
            held.extend([(); 2].map(|()| session.ask(&vec![Aabb::EMPTY; 50_000])));
        }
        "load" => {
            println!("ready");
            loop {
                frame_of(&mut session, 1_000)?.wait()?;
            }
        }
        "greedy" => return greedy(&mut session),
        "pile" => {
            let pending = session.ask(&vec![at(0.0); PILED_BOXES]);
            println!("ready");
            pending.wait()?;
            println!("answered");
        }
        "long" => {
            let boxes: Vec<Aabb> = (0..LONG_BOXES).map(|i| at(2.0 * i as f32)).collect();
            held.push(session.ask(&boxes));
        }
        "right" => {
            right(&mut session);
            return Ok(());
        }
        "shared" => return shared(&mut session),
        "truncate" => {
            held.push(session.ask(&vec![Aabb::EMPTY; 50_000]));
            truncate_own_segments()?;
        }
        _ => return Err(format!("unknown mode '{mode}'").into()),
    }
    ready(held)
}

/// Boxes of the client with a pile: half a second on a core, for as many pairs as a sparse mask holds.
const PILED_BOXES: usize = 30_000;
/// Boxes of the client that waits for long: minutes of all cores, where all pairs are tested.
const LONG_BOXES: usize = 1_000_000;
const GREEDY_BOXES: u32 = 600_000;

/// Boxes in a row, each of which touches the next.
fn frame_of(session: &mut Session, n: u32) -> Result<Pending<PairMask>, Box<dyn Error>> {
    let mut frame = session.frame(n as usize)?;
    for (i, slot) in frame.boxes_mut().iter_mut().enumerate() {
        *slot = Aabb::new([i as f32, 0.0, 0.0], [i as f32 + 1.0, 1.0, 1.0]);
    }
    Ok(frame.submit()?)
}

/// Ten boxes around the origin that are no pairs of each other, and meet what is there.
fn shared(session: &mut Session) -> Result<(), Box<dyn Error>> {
    let name = std::env::args().nth(3).ok_or("shared needs the scene's name")?;
    let mut scene = session.scene(SceneOptions::default().with_shared(&name))?;
    // Those of a writer that was killed are free a moment later.
    while let Err(error) = scene.lease(10..20) {
        if !matches!(error, pairmask::Error::Lease(_)) {
            return Err(error.into());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    println!("ready");
    std::io::stdout().flush()?;
    loop {
        let edit = scene.edit().set_with(10..20, |index| {
            let y = (index - 10) as f32 * 0.1;
            Aabb::new([0.0, y, 0.0], [0.5, y + 0.05, 0.5])
        });
        drop(edit.commit(Report::Nothing)?);
    }
}

fn greedy(session: &mut Session) -> Result<(), Box<dyn Error>> {
    let mut waiting = VecDeque::new();
    println!("ready");
    loop {
        while waiting.len() < FRAMES_AT_A_TIME {
            waiting.push_back(frame_of(session, GREEDY_BOXES)?);
        }
        if let Some(oldest) = waiting.pop_front() {
            oldest.wait()?;
        }
    }
}

/// Frames of twice as many objects each, until one is refused.
fn fill_up(
    session: &mut Session,
    fill: fn(&mut Session, usize) -> Result<(), pairmask::Error>,
) -> pairmask::Error {
    let mut n = 1000;
    loop {
        if let Err(error) = fill(session, n) {
            return error;
        }
        n *= 2;
    }
}

fn fill_boxes(session: &mut Session, n: usize) -> Result<(), pairmask::Error> {
    session.frame(n).map(|mut frame| frame.boxes_mut().fill(Aabb::EMPTY))
}

fn fill_spheres(session: &mut Session, n: usize) -> Result<(), pairmask::Error> {
    session.sphere_frame(n).map(|mut frame| frame.spheres_mut().fill(Sphere::EMPTY))
}

/// Answers that are held to the oracle, until the input ends.
fn right(session: &mut Session) {
    let scenes = [64, 500, 1500].map(|n| stress_scenes::named("uniform").boxes(n, u64::from(n)));
    let scenes = scenes.map(|boxes| (oracle::truth(&boxes).pairs, boxes));
    println!("ready");
    let input = std::thread::spawn(|| std::io::stdin().lines().count());
    let mut answers = 0_u64;
    for (pairs, boxes) in scenes.iter().cycle() {
        let answer = session.ask(boxes).wait();
        if !answer.as_ref().is_ok_and(|mask| mask.sorted() == *pairs) {
            println!("wrong: {:?}", answer.err());
        }
        answers += 1;
        if input.is_finished() {
            break;
        }
    }
    println!("{answers} answers");
}

/// Prints `ready`, and holds its memory until killed.
fn ready<T>(_held: T) -> Result<(), Box<dyn Error>> {
    println!("ready");
    std::io::stdout().flush()?;
    loop {
        std::thread::sleep(Duration::from_secs(1));
    }
}

/// Cuts every segment that this process maps for writing. Touching a frame afterwards kills this
/// process.
fn truncate_own_segments() -> Result<(), Box<dyn Error>> {
    let mut cut = 0;
    for file in fs::read_dir("/proc/self/fd")?.flatten() {
        let target = fs::read_link(file.path()).unwrap_or_default();
        // The daemon's cannot be opened for writing by a descriptor that only reads, where it is another user's.
        if target.to_string_lossy().starts_with("/dev/shm/pairmask_") {
            OpenOptions::new().write(true).open(file.path())?.set_len(0)?;
            cut += 1;
        }
    }
    if cut == 0 { Err("no segment found".into()) } else { Ok(()) }
}
