// Where the items of each world begin. The other form is `written_worlds_none`.

// Of `pair_rules_ruled`. Bindings of rules come behind those of the stage, and are numbered when it is put
// together.
@group(0) @binding(BEHIND) var<storage, read> row_worlds: array<vec2<u32>>;
// For each world, by rank, the number of items before its own.
@group(0) @binding(BEHIND_THAT) var<storage, read_write> world_firsts: array<u32>;

// Informs the host of the world whose first row this is, if it is one. `first_entry` is that of its batch.
fn report_worlds(row: u32, first_entry: u32) {
    if (grid.worlds.count > 1u && row < params.n) {
        let noted = row_worlds[row];
        // Rows beyond the budget noted nothing, and what is there may be of another frame.
        if (noted.x != 0u && noted.x <= grid.worlds.count) {
            world_firsts[noted.x - 1u] = first_entry + noted.y;
        }
    }
}
