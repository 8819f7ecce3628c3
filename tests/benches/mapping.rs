//! The mapping function study on this machine. Needs a Vulkan driver for the GPU's part and
//! nothing else.
//!
//! `mapping [--gpu auto|none|software|INDEX|NAME] [--quick] [--out DIR] [--json]`

use std::process::ExitCode;

use pairmaskd::study::mapping::{MappingOptions, run};

fn main() -> ExitCode {
    let Some(options) = parse(std::env::args().skip(1)) else {
        eprintln!("usage: mapping [--gpu CHOICE] [--quick] [--out DIR] [--json]");
        return ExitCode::from(2);
    };
    match run(&options) {
        Ok(_) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn parse(mut args: impl Iterator<Item = String>) -> Option<MappingOptions> {
    let mut options = MappingOptions::default();
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--gpu" => options.gpu = args.next()?.parse().ok()?,
            "--quick" => options.quick = true,
            "--out" => options.out = Some(args.next()?.into()),
            "--json" => options.json = true,
            // Passed by `cargo bench`.
            "--bench" => {}
            _ => return None,
        }
    }
    Some(options)
}
