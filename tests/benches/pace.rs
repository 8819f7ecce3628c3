//! Frames in process at a game's pace: what it gains that threads of the pool are awake when one is due.
//!
//! ```text
//! cargo bench -p pairmask-tests --bench pace [-- --n 10000,100000] [--rate 60,240] [--seconds 3] [--rounds 3]
//! ```
//!
//! `steady` frames come at equal intervals, which the session learns. `unsteady` ones come as often, each as
//! soon as half an interval after the last or as late as one and a half, so that nobody can be awake in
//! time. A frame is from the first box written to the last pair visited; µs. `cpu` is what the process uses of
//! a core, of which the waiting for due times is none.

use std::error::Error;
use std::hint::black_box;
use std::time::{Duration, Instant};

use pairmask::{Backend, Session};
use pairmaskd::scene::{Random, Scene, SceneName};

/// Share of a run that is not counted: the pace is learned, memory is taken.
const WARM_UP_SHARE: usize = 5;
/// Ticks of the kernel's CPU time in a second, as Linux tells them to all programs.
const TICKS: f64 = 100.0;

/// When frames come.
#[derive(Clone, Copy, Debug)]
enum Intervals {
    Unsteady,
    Steady,
}

/// What a run is asked for.
#[derive(Clone, Copy, Debug)]
struct Run {
    n: usize,
    rate: f64,
    seconds: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let (mut sizes, mut rates) = (vec![10_000, 100_000], vec![60.0, 240.0]);
    let (mut seconds, mut rounds) = (3.0, 3);
    let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
    while let Some(flag) = args.next() {
        let value = args.next().ok_or_else(|| format!("{flag} needs a value"))?;
        match flag.as_str() {
            "--n" => sizes = value.split(',').map(str::parse).collect::<Result<_, _>>()?,
            "--rate" => rates = value.split(',').map(str::parse).collect::<Result<_, _>>()?,
            "--seconds" => seconds = value.parse()?,
            "--rounds" => rounds = value.parse::<usize>()?,
            _ => return Err(format!("unknown argument {flag}").into()),
        }
    }
    println!("   boxes  rate intervals      p50      p90      p99   cpu %");
    for n in sizes {
        for &rate in &rates {
            for _ in 0..rounds {
                for intervals in [Intervals::Unsteady, Intervals::Steady] {
                    row(Run { n, rate, seconds }, intervals)?;
                }
            }
        }
    }
    Ok(())
}

fn row(run: Run, intervals: Intervals) -> Result<(), Box<dyn Error>> {
    let Run { n, rate, seconds } = run;
    let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    let mut scene = Scene::new(SceneName::Uniform, n, 1);
    let mut random = Random::new(7);
    let frames = (rate * seconds) as usize;
    let mut times = Vec::with_capacity(frames);
    let (mut due, before) = (Instant::now(), cpu_seconds()?);
    let start = due;
    for frame in 0..frames {
        scene.step();
        let periods = match intervals {
            Intervals::Steady => 1.0,
            Intervals::Unsteady => 0.5 + f64::from(random.unit()),
        };
        due += Duration::from_secs_f64(periods / rate);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let took = time(&mut session, &scene)?;
        if frame >= frames / WARM_UP_SHARE {
            times.push(took);
        }
    }
    let percent = (cpu_seconds()? - before) / start.elapsed().as_secs_f64() * 100.0;
    times.sort_unstable_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    println!(
        "{n:>8} {rate:>5} {:<9} {:>8.1} {:>8.1} {:>8.1} {percent:>7.1}",
        format!("{intervals:?}").to_lowercase(),
        at(0.5),
        at(0.9),
        at(0.99)
    );
    Ok(())
}

/// A frame, µs.
fn time(session: &mut Session, scene: &Scene) -> Result<f64, Box<dyn Error>> {
    let start = Instant::now();
    let mut frame = session.frame(scene.boxes().len())?;
    frame.write(scene.boxes());
    frame.submit()?.wait()?.for_each_slice(|pairs| {
        black_box(pairs);
    });
    Ok(start.elapsed().as_secs_f64() * 1e6)
}

/// CPU time of all threads of this process so far.
fn cpu_seconds() -> Result<f64, Box<dyn Error>> {
    let stat = std::fs::read_to_string("/proc/self/stat")?;
    // The name, which may hold blanks, ends with the last bracket; the times are the 12th and 13th after it.
    let fields = stat.rsplit(')').next().unwrap_or_default();
    let ticks: Result<Vec<f64>, _> =
        fields.split_whitespace().skip(11).take(2).map(str::parse).collect();
    Ok(ticks?.iter().sum::<f64>() / TICKS)
}
