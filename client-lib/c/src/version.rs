//! Which version of the library this is.

/// The version of the header: `PM_VERSION == pm_version()` where the program was compiled with the header of
/// the library that it has loaded. Major, minor and patch, 8 bits each from bit 16 down.
pub const PM_VERSION: u32 = 0x00_01_00;

/// The version of the library that was loaded, as `PM_VERSION` writes it. Before 1.0, a program works with
/// libraries of its minor version; from then on, with those of its major version that are not older.
#[allow(unsafe_code)] // The name is one of the header's.
#[unsafe(no_mangle)]
pub extern "C" fn pm_version() -> u32 {
    PM_VERSION
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_version_is_the_crates() {
        let of = |part: &str| part.parse::<u32>().expect("a number");
        let crates = of(env!("CARGO_PKG_VERSION_MAJOR")) << 16
            | of(env!("CARGO_PKG_VERSION_MINOR")) << 8
            | of(env!("CARGO_PKG_VERSION_PATCH"));
        assert_eq!(super::pm_version(), crates);
    }
}
