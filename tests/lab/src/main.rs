//! The `pairmask-lab` binary: the whole command line is in the library.

fn main() -> std::process::ExitCode {
    pairmask_lab::cli::main()
}
