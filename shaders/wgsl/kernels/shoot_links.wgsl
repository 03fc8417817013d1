// Shooters send along their rows: row j is column j, by reciprocity. Workgroups share the list of shooters, lanes a row.
// What arrives is added up in whole units by integer atomics: the same bits in any order.
// CPU twin: `radiosity::solver::flux`.

@group(0) @binding(1) var<storage, read> residents: array<Resident>;
@group(0) @binding(2) var<storage, read> rows: array<LiveRow>;
@group(0) @binding(3) var<storage, read> links: array<Link>;
@group(0) @binding(4) var<storage, read> shooters: array<u32>;
@group(0) @binding(5) var<storage, read> shot: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> shot_words: array<u32>;
@group(0) @binding(7) var<storage, read_write> arrived: array<atomic<i32>>;

@compute @workgroup_size(256)
fn shoot_links(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let per_unit = UNITS_OF_BRIGHTEST / max(bitcast<f32>(shot_words[SHOT_BRIGHTEST]), BRIGHTEST_MIN);
    for (var at = group.x; at < shot_words[SHOT_LISTED]; at += pass_of.entry_count) {
        let slot = shooters[at];
        let row = rows[slot];
        let flux = shot[slot].xyz * residents[slot].area;
        for (var item = lane; item < row.count; item += LANES) {
            let link = links[row.first + item];
            let scale = link.share / residents[link.slot].area * per_unit;
            let units = vec3<i32>(round(flux * scale));
            for (var channel = 0u; channel < 3u; channel++) {
                atomicAdd(&arrived[3u * link.slot + channel], units[channel]);
            }
        }
    }
}
