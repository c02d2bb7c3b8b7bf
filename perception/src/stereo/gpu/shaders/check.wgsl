// Left-right check: writes a map of disparity and confidence of the winners that are consistent with the right view.

@group(0) @binding(0) var<uniform> scale: Scale;
@group(0) @binding(1) var<storage, read> winners: array<u32>;
@group(0) @binding(2) var<storage, read> right_view: array<u32>;
@group(0) @binding(3) var<storage, read_write> map: array<u32>;

// Confidence that a winner loses when the two views differ.
const DISAGREEMENT = 30u;

@compute @workgroup_size(64)
fn check(@builtin(global_invocation_id) id: vec3<u32>) {
    let x = id.x;
    if x >= scale.width {
        return;
    }
    let row = id.y * scale.width;
    let winner = winners[row + x];
    let place = winner >> 24u;
    var kept = 0u;
    if place >= 1u && place <= x {
        let seen = right_view[row + x - place] & 0xffu;
        let difference = apart(seen, place);
        var sure = confidence_of(winner);
        if difference > 0u {
            sure = max(sure - min(sure, DISAGREEMENT), 1u);
        }
        if difference <= scale.left_right && sure >= scale.min_confidence {
            kept = disparity_of(winner) | (sure << 16u);
        }
    }
    map[row + x] = kept;
}
