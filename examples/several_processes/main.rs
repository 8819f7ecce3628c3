//! One scene, several processes: four write 25,000 boxes each, a fifth only listens and draws what it counts.
//! One of the four is killed on the way, and comes back.

mod arguments;
mod roles;

use std::process::ExitCode;

use arguments::{Arguments, HELP, Role};

fn main() -> ExitCode {
    env_logger::init();
    let done = match Arguments::parse(std::env::args().skip(1)) {
        Ok(Arguments { role: Role::Help, .. }) => {
            print!("{HELP}");
            Ok(())
        }
        Ok(arguments) => match arguments.role {
            Role::Writer(which) => roles::write(&arguments, which),
            Role::Listener => roles::listen(&arguments),
            _ => roles::start_all(&arguments),
        },
        Err(error) => Err(error.into()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("several_processes: {error}");
            ExitCode::FAILURE
        }
    }
}
