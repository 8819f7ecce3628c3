//! `man`: manual pages, made from the definitions of the command line.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::{Args, Command};
use clap_mangen::Man as Page;
use clap_mangen::roff::{Roff, roman};

use super::output::{make_folder, write_file, write_stdout};
use super::program::{Result, WrongUsage};
use super::shape;

/// Write manual pages: one to stdout, or all into a directory
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pairmaskd man | man -l -                     the page of pairmaskd
  pairmaskd man bench latency | man -l -       that of a command
  pairmaskd man --out ~/.local/share/man/man1  all pages, where man finds them")]
pub struct Man {
    /// Words of the command whose page is written [default: none, the page of pairmaskd]
    #[arg(value_name = "COMMAND", conflicts_with = "out")]
    command: Vec<String>,
    /// Directory to write the page of each command into
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Man {
    pub fn run(&self) -> Result {
        let mut all = shape::command().disable_help_subcommand(true);
        all.build();
        if let Some(folder) = &self.out {
            make_folder(Some(folder))?;
            return write_pages(&all, folder);
        }
        let mut command = &all;
        for word in &self.command {
            command = command.find_subcommand(word).ok_or_else(|| {
                WrongUsage(format!("there is no command '{word}': see `pairmaskd --help`"))
            })?;
        }
        let mut page = Vec::new();
        write_page(&page_of(command), command, &mut page)?;
        Ok(write_stdout(&page)?)
    }
}

/// Writes the pages of a command and of those below it.
fn write_pages(command: &Command, folder: &Path) -> Result {
    for inner in command.get_subcommands().filter(|inner| !inner.is_hide_set()) {
        write_pages(inner, folder)?;
    }
    let page = page_of(command);
    write_file(&folder.join(page.get_filename()), |file| write_page(&page, command, file))
}

fn page_of(command: &Command) -> Page {
    let version = env!("CARGO_PKG_VERSION");
    Page::new(command.clone()).source(format!("pairmaskd {version}"))
}

/// As [`Page::render`], but lines of examples stay as they are.
fn write_page(page: &Page, command: &Command, to: &mut dyn Write) -> io::Result<()> {
    page.render_title(to)?;
    page.render_name_section(to)?;
    page.render_synopsis_section(to)?;
    page.render_description_section(to)?;
    page.render_options_section(to)?;
    if command.has_subcommands() {
        page.render_subcommands_section(to)?;
    }
    let Some(notes) = command.get_after_help() else { return Ok(()) };
    let mut roff = Roff::new();
    roff.control("SH", ["NOTES"]).control("nf", []);
    for line in notes.to_string().lines() {
        roff.text([roman(line)]);
    }
    roff.control("fi", []);
    roff.to_writer(to)
}
