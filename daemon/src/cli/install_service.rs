//! `install-service`: a unit of the user's systemd that serves an instance.
//!
//! The unit is the one that packages install, with the path of this program. One that somebody else has written, or
//! masked, stays as it is.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use clap::Args;
use pairmask_wire::InstanceName;

use super::options::CommonOptions;
use super::output::{make_folder, print_aside, print_text, write_file, write_stdout};
use super::program::Result;
use crate::file_error::{Access, FileError};
use crate::user_base;

/// Write a systemd unit of this user that serves an instance
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pairmaskd install-service && systemctl --user enable --now pairmaskd
  pairmaskd install-service --instance world   a unit named pairmaskd-world
  pairmaskd install-service --print            what it would write
  systemctl --user disable --now pairmaskd && pairmaskd install-service --uninstall

The unit starts this program where it lies now, with the settings of the configuration file.")]
pub struct InstallService {
    /// Print the unit, and write nothing
    #[arg(long, conflicts_with = "uninstall")]
    print: bool,
    /// Remove the unit, and the link by which it starts with the user's session
    #[arg(long)]
    uninstall: bool,
}

#[derive(Debug, thiserror::Error)]
enum UnitError {
    #[error("there is no directory for units: set HOME, or XDG_CONFIG_HOME")]
    NoFolder,
    #[error(
        "{}: it was not written by this command: remove it first, if it may go", path.display()
    )]
    NotOurs { path: PathBuf },
    #[error("{}: this path cannot be written in a unit: move the program", path.display())]
    Path { path: PathBuf },
    #[error("this program's path is not known: {0}")]
    NoPath(#[source] io::Error),
}

/// As packages install it. The program's path is the one that they have.
const UNIT: &str = include_str!("../../packaging/pairmaskd.service");
const PACKAGED_COMMAND: &str = "\"/usr/bin/pairmaskd\" serve";

impl InstallService {
    pub fn run(&self, common: &CommonOptions) -> Result {
        let instance = common.instance();
        let name = unit_name(&instance);
        let program = || std::env::current_exe().map_err(UnitError::NoPath);
        if self.print {
            return Ok(write_stdout(unit(&program()?, &instance)?.as_bytes())?);
        }
        let folder = user_base("XDG_CONFIG_HOME", ".config").ok_or(UnitError::NoFolder)?;
        let folder = folder.join("systemd/user");
        let path = folder.join(format!("{name}.service"));
        let is_there = is_ours(&path)?;
        if self.uninstall {
            let link = folder.join("default.target.wants").join(format!("{name}.service"));
            remove(&link)?;
            if is_there {
                remove(&path)?;
                print_text(&format!("removed {}", path.display()))?;
            }
            print_aside("then: systemctl --user daemon-reload");
            return Ok(());
        }
        let text = unit(&program()?, &instance)?;
        make_folder(Some(&folder))?;
        write_file(&path, |file| file.write_all(text.as_bytes()))?;
        print_text(&format!("wrote {}", path.display()))?;
        print_aside(&format!(
            "then: systemctl --user daemon-reload && systemctl --user enable --now {name}"
        ));
        Ok(())
    }
}

fn unit_name(instance: &InstanceName) -> String {
    if *instance == InstanceName::default() {
        "pairmaskd".into()
    } else {
        format!("pairmaskd-{instance}")
    }
}

fn unit(program: &Path, instance: &InstanceName) -> Result<String, UnitError> {
    let unwritable = || UnitError::Path { path: program.to_owned() };
    let path = program.to_str().filter(|path| !path.chars().any(char::is_control));
    let path = path.ok_or_else(unwritable)?;
    // As systemd reads it: `%` begins a specifier.
    let path = path.replace('\\', r"\\").replace('"', r#"\""#).replace('%', "%%");
    let is_default = *instance == InstanceName::default();
    let instance = if is_default { String::new() } else { format!(" --instance {instance}") };
    let command = format!("\"{path}\" serve{instance}");
    Ok(UNIT.replace(PACKAGED_COMMAND, &command))
}

/// Whether there is a unit that this command wrote. That there is another one is an error.
fn is_ours(path: &Path) -> Result<bool> {
    match std::fs::read_to_string(path) {
        Ok(text) if text.lines().next() == UNIT.lines().next() => Ok(true),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
        Ok(_) => Err(UnitError::NotOurs { path: path.to_owned() }.into()),
        Err(error) => Err(FileError::of(path, Access::Read)(error).into()),
    }
}

/// Removes a file, or a link, if there is one.
fn remove(path: &Path) -> Result<(), FileError> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(FileError::of(path, Access::Remove)(error))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_starts_this_program_where_it_lies() {
        for (program, instance, expected) in [
            ("/opt/pairmaskd", "default", "ExecStart=\"/opt/pairmaskd\" serve\n"),
            ("/a b/50%/p", "world", "ExecStart=\"/a b/50%%/p\" serve --instance world\n"),
            (r#"/a\"b"#, "default", "ExecStart=\"/a\\\\\\\"b\" serve\n"),
        ] {
            let text = unit(program.as_ref(), &instance.parse().expect("a name")).expect(program);
            assert!(text.contains(expected), "{text}");
            assert_eq!(text.matches("ExecStart").count(), 1, "{text}");
            assert!(text.lines().next() == UNIT.lines().next(), "{text}");
        }
        assert!(unit("/a\nb".as_ref(), &InstanceName::default()).is_err());
    }
}
