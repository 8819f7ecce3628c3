//! What each process does.

use std::error::Error;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use pairmask::{Aabb, Backend, Report, Scene, SceneOptions, Scope, Session};

use crate::arguments::Arguments;

/// The scene's name in the daemon.
const SCENE: &str = "several-processes";
/// Writers, each with a range of indices of its own.
pub const WRITERS: u32 = 4;
/// A tick waits so long for a writer: it may be dead.
const DEADLINE: Duration = Duration::from_millis(50);
/// Boxes that move in a tick: one in so many.
const MOVING_SHARE: u32 = 10;
/// A member waits so long for a range of indices, or for the daemon.
const TIMEOUT: Duration = Duration::from_secs(10);

fn join(scope: Scope) -> Result<(Session, Scene), Box<dyn Error>> {
    let mut session = Session::builder().backend(Backend::Daemon).connect()?;
    let options = SceneOptions::default().with_tick_deadline(DEADLINE).with_scope(scope);
    let scene = session.scene(options.with_shared(SCENE))?;
    Ok((session, scene))
}

/// Starts all others, kills a writer on the way and starts it again. Ends with the listener.
pub fn start_all(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    // A wrong setup is reported here, and not by five processes.
    drop(join(Scope::All)?);
    let mut listener = start(arguments, &["--listen".into()], Stdio::inherit())?;
    let mut writers = Vec::new();
    for which in 0..WRITERS {
        writers.push(start_writer(arguments, which)?);
    }
    let start = Instant::now();
    let mut was_killed = false;
    while listener.0.try_wait()?.is_none() {
        if !was_killed && start.elapsed() > Duration::from_secs(1) {
            was_killed = true;
            // Its boxes end as removed within a second. It leases the same range again, and sets them anew.
            writers.swap_remove(1);
            println!("writer 1 is killed, and started again");
            writers.push(start_writer(arguments, 1)?);
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    let status = listener.0.wait()?;
    if status.success() { Ok(()) } else { Err(format!("the listener: {status}").into()) }
}

/// A process of this example; killed when dropped.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start_writer(arguments: &Arguments, which: u32) -> Result<Process, Box<dyn Error>> {
    start(arguments, &["--write".into(), which.to_string()], Stdio::null())
}

fn start(arguments: &Arguments, role: &[String], out: Stdio) -> Result<Process, Box<dyn Error>> {
    let child = Command::new(std::env::current_exe()?)
        .args(["--boxes", &arguments.boxes.to_string()])
        .args(["--ticks", &arguments.ticks.to_string()])
        .args(role)
        .stdout(out)
        .spawn()?;
    Ok(Process(child))
}

/// Where a box is at a step: on a ring of its own, in a square that all writers share.
fn box_at(index: u32, step: u64, boxes: u32) -> Aabb {
    let side = (f64::from(boxes * WRITERS)).sqrt().ceil() as u32;
    // Neighbours in space belong to different writers.
    let (writer, own) = (index / boxes, index % boxes);
    let cell = own * WRITERS + writer;
    let (x, y) = ((cell % side) as f32, (cell / side) as f32);
    let angle = 0.1 * step as f32 + 0.7 * index as f32;
    let centre = [x + 0.4 * angle.cos(), y + 0.4 * angle.sin(), 0.0];
    Aabb::new(centre.map(|c| c - 0.4), centre.map(|c| c + 0.4))
}

/// Writes the boxes of one range, until it is killed or the scene has no listener any more.
pub fn write(arguments: &Arguments, which: u32) -> Result<(), Box<dyn Error>> {
    let (_session, mut scene) = join(Scope::Own)?;
    let boxes = arguments.boxes;
    let own = which * boxes..(which + 1) * boxes;
    let start = Instant::now();
    // The range of a writer that was killed is free a moment later.
    while let Err(error) = scene.lease(own.clone()) {
        if !matches!(error, pairmask::Error::Lease(_)) || start.elapsed() > TIMEOUT {
            return Err(error.into());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let all: Vec<Aabb> = own.clone().map(|index| box_at(index, 0, boxes)).collect();
    drop(scene.edit().set_all(own.clone(), &all).commit(Report::Changes)?);
    for step in 1.. {
        let moving: Vec<u32> = own
            .clone()
            .filter(|index| (u64::from(*index) + step).is_multiple_of(u64::from(MOVING_SHARE)))
            .collect();
        let moved: Vec<Aabb> = moving.iter().map(|index| box_at(*index, step, boxes)).collect();
        match scene.edit().set_all(&moving, &moved).commit(Report::Changes) {
            Ok(answer) => drop(answer),
            Err(_) if start.elapsed() < TIMEOUT => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

/// Counts what the ticks report, and prints a line now and then.
pub fn listen(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let (_session, mut scene) = join(Scope::All)?;
    let (mut pairs, mut begun, mut ended, mut late) = (0u64, 0u64, 0u64, 0u64);
    let mut printed = Instant::now();
    let mut seen = 0;
    while seen < arguments.ticks {
        let answer = scene.edit().commit(Report::Changes)?;
        pairs = if answer.is_resync() {
            answer.pairs().len() as u64
        } else {
            pairs + answer.begun().len() as u64 - answer.ended().count() as u64
        };
        if answer.pair_count() != Some(pairs) {
            return Err(format!("{pairs} pairs counted, {:?} reported", answer.pair_count()).into());
        }
        if pairs == 0 {
            // The writers are on their way.
            drop(answer);
            std::thread::sleep(Duration::from_millis(1));
            continue;
        }
        seen += 1;
        begun += answer.begun().len() as u64;
        ended += answer.ended().count() as u64;
        late += u64::from(!answer.late().is_empty());
        if printed.elapsed() > Duration::from_millis(200) || seen == arguments.ticks {
            printed = Instant::now();
            let bar = "#".repeat((pairs * 40 / (4 * u64::from(arguments.boxes) + 1)) as usize % 60);
            println!("tick {:6}  {pairs:7} pairs  {bar}", answer.tick().unwrap_or_default());
        }
    }
    println!("{begun} pairs began, {ended} ended; in {late} of {seen} ticks a writer was late");
    Ok(())
}
