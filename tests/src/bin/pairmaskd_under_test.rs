//! The daemon's own main, as a binary of this package: cargo builds it before the tests that
//! start it.

use std::process::ExitCode;

fn main() -> ExitCode {
    stub()
}

fn stub() -> ExitCode {
    eprintln!("start {:?}", std::env::args().collect::<Vec<_>>());
    use pairmaskd::serve::*;
    let args: Vec<String> = std::env::args().collect();
    let val = |k: &str| args.iter().position(|a| a == k).map(|i| args[i + 1].clone());
    let mut limits = pairmask::transport::Limits::default();
    if let Some(v) = val("--max-clients") {
        limits.max_clients = v.parse().unwrap();
    }
    if let Some(v) = val("--max-reply-mib") {
        limits.max_reply_bytes = v.parse::<u64>().unwrap() << 20;
    }
    let s = ServeSettings {
        instance: Default::default(),
        dir: pairmask::transport::RuntimeDir::from_env(),
        limits,
        spin: std::time::Duration::from_micros(50),
        gpu: val("--gpu").unwrap_or("none".into()).parse().unwrap(),
    };
    let r = if args.iter().any(|a| a == "--worker") { work(&s) } else { supervise(&s) };
    if let Err(e) = r {
        eprintln!("{e}");
        return ExitCode::from(1);
    }
    ExitCode::SUCCESS
}
