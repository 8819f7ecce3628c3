//! Temporary.
use pairmask::*;
use pairmaskd::serve::*;
use std::time::*;
fn main() {
    env_logger::init();
    let args: Vec<String> = std::env::args().collect();
    let s = ServeSettings {
        instance: Default::default(),
        dir: pairmask::transport::RuntimeDir::from_env(),
        limits: Default::default(),
        spin: Duration::from_micros(if args.iter().any(|a| a == "event") { 0 } else { 50 }),
    };
    if args.get(1).map(String::as_str) == Some("serve") {
        let r = if args.get(2).map(String::as_str) == Some("--worker") {
            work(&s)
        } else {
            supervise(&s)
        };
        if let Err(e) = r {
            eprintln!("{e}");
            std::process::exit(1)
        }
        return;
    }
    let n: usize = args[1].parse().unwrap();
    let spin = if args.get(2).map(String::as_str) == Some("event") {
        Duration::ZERO
    } else {
        Duration::from_secs(1)
    };
    let mut session = Session::builder().backend(Backend::Auto).spin(spin).connect().unwrap();
    println!("{:?}", session.served_by());
    let mut rt = vec![];
    let mut eng = vec![];
    let mut dec = vec![];
    let mut total = vec![];
    let src: Vec<Aabb> = (0..n)
        .map(|i| {
            let r = |k: usize| {
                ((i * 2654435761 + k * 40503).wrapping_mul(2246822519) >> 7) as f32 % 10007.0
                    / 10007.0
            };
            let s = (n as f32).cbrt() * 2.0;
            let m = glam::Vec3::new(r(1) * s, r(2) * s, r(3) * s);
            Aabb::new(m, m + 1.0)
        })
        .collect();
    let mut count = 0;
    let mut here = 0;
    for i in 0..3000 {
        let t0 = Instant::now();
        let mut f = session.frame(n).unwrap();
        f.boxes_mut().copy_from_slice(&src);
        let t1 = Instant::now();
        let m = f.submit().unwrap().wait().unwrap();
        let t2 = Instant::now();
        count = m.pairs().count() as u64;
        assert_eq!(count, m.count());
        let t3 = Instant::now();
        if m.info().served_by == ServedBy::InProcess {
            here += 1;
        }
        if i > 500 {
            rt.push((t2 - t1).as_nanos() as u64);
            eng.push(m.info().times.total_ns);
            dec.push((t3 - t2).as_nanos() as u64);
            total.push((t3 - t0).as_nanos() as u64);
        }
    }
    for (name, v) in
        [("rt", &mut rt), ("engine", &mut eng), ("decode", &mut dec), ("total", &mut total)]
    {
        v.sort();
        println!(
            "{name}: p50 {} p90 {} p99 {}",
            v[v.len() / 2],
            v[v.len() * 9 / 10],
            v[v.len() * 99 / 100]
        );
    }
    println!("pairs {count} in process {here}");
    println!("{:?}", session.daemon_status().map(|s| (s.frames, s.client_count, s.pairs)));
}
