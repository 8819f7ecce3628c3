//! Writes the structs that WGSL and Rust share, in Rust, from their text in WGSL: `layouts.rs` of the output folder.

use std::path::Path;
use std::{env, fs, io};

/// What Rust reads or writes.
const SHARED: [&str; 18] = [
    "AwakeParams",
    "BatchReport",
    "BatchTotals",
    "CastGroupsParams",
    "CastLevel",
    "CastParams",
    "GridLayout",
    "GridLevel",
    "GridParams",
    "GridSummary",
    "GridTotals",
    "GridWorlds",
    "KeysParams",
    "PackParams",
    "PairsParams",
    "SceneParams",
    "SceneSummary",
    "WriteParams",
];

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=wgsl");
    let mut wgsl = String::new();
    for folder in ["wgsl", "wgsl/shared"] {
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_file() {
                wgsl += &fs::read_to_string(path)?;
            }
        }
    }
    let (mut structs, mut layouts) = (Vec::new(), Vec::new());
    for name in SHARED {
        let after = wgsl.split_once(&format!("struct {name} {{\n"));
        let body = after.and_then(|(_, text)| text.split_once("\n}"));
        let (body, _) = body.ok_or_else(|| io::Error::other(format!("no struct {name}")))?;
        let lines = body.lines().map(str::trim).filter(|line| !line.starts_with("//"));
        let members = lines.filter_map(|line| line.strip_suffix(',')?.split_once(": "));
        let (members, offsets): (Vec<_>, Vec<_>) = members
            .map(|(member, of)| {
                let offset = format!("(\"{member}\", std::mem::offset_of!({name}, {member})), ");
                (format!("    pub {member}: {},\n", rust_type(of)), offset)
            })
            .unzip();
        structs.push(format!(
            "#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]\n#[repr(C)]\n\
             pub struct {name} {{\n{}}}\n\n\
             impl Default for {name} {{\n    fn default() -> Self {{\n        \
             Zeroable::zeroed()\n    }}\n}}\n\n",
            members.concat()
        ));
        let offsets = offsets.concat();
        layouts.push(format!("    (\"{name}\", size_of::<{name}>(), &[{offsets}]),\n"));
    }
    structs.push(format!(
        "#[cfg(test)]\npub(crate) const LAYOUTS: &[Layout] = &[\n{}];\n",
        layouts.concat()
    ));
    let out = env::var_os("OUT_DIR").ok_or(io::ErrorKind::NotFound)?;
    fs::write(Path::new(&out).join("layouts.rs"), structs.concat())
}

/// A type of WGSL in Rust.
fn rust_type(wgsl: &str) -> String {
    let of = |start| wgsl.strip_prefix(start)?.strip_suffix('>');
    if let Some(number) = of("vec2<") {
        return format!("[{number}; 2]");
    }
    if let Some(number) = of("vec3<") {
        return format!("[{number}; 3]");
    }
    match of("array<").and_then(|inner: &str| inner.rsplit_once(", ")) {
        Some((element, count)) if count.starts_with(|first: char| first.is_ascii_digit()) => {
            format!("[{}; {count}]", rust_type(element))
        }
        Some((element, count)) => format!("[{}; {count} as usize]", rust_type(element)),
        None => wgsl.to_owned(),
    }
}
