//! libFuzzer drives [`masks`](pairmask_fuzz::masks).
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| pairmask_fuzz::masks::decode(data));
