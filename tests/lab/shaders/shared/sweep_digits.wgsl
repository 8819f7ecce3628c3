// The entries of a thread, eight in a row, by the digit of the pass. Entries behind the last one have a digit
// of their own value, and are left out.

@group(0) @binding(0) var<storage, read_write> control: array<atomic<u32>>;
@group(0) @binding(1) var<storage, read> keys: array<u32>;

fn entries_in_all() -> u32 {
    let count = atomicLoad(&control[ENTRIES]);
    return select(count, 0u, count > params.entry_capacity);
}

fn digit_of(key: u32) -> u32 {
    return (key >> params.shift) & (DIGITS - 1u);
}
