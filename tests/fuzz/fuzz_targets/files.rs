//! libFuzzer drives [`files`](pairmask_fuzz::files).
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| pairmask_fuzz::files::decode(data));
