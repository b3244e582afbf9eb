// A hollow ball: drilled along the six diagonals of an icosahedron, dimpled all over, and held on three axles that
// carry a strut frame inside it. Spheres and cylinders only. Lengths are model units; the ball's radius is about 10.
//
// More than `most_per_ball` primitives make more balls, in a cubic lattice joined axle to axle.

halfspaces = 612;      // primitives in all
most_per_ball = 612;   // primitives in one ball, at most
seed = 1;              // draws the differences between dimples and between balls
vary = 0;              // how large those are: 0 all alike, 0.2 twenty percent
made = undef;          // numbers of the balls to make: all, or a list

ball_r = 10;           // outside of the shell
wall = 1.3;            // thickness of the shell
port_r = 2.3;          // drilled holes, where the frame's joints look out
rim_r = 2.9;           // counterbore around each port
rim_depth = 0.8;       // of the counterbore, below the top of the ball
frame_r = 7.4;         // centre of the ball to a joint of the frame
axle_r = 0.6;          // the three differ by a little where they cross
axle_end = 11.6;       // centre of the ball to the centre of an axle's knob
pitch = 2 * axle_end + 0.9;  // between balls: the knobs of two neighbours overlap without coinciding

shell_color = [0.86, 0.84, 0.78];
dimple_color = [0.10, 0.33, 0.55];
cavity_color = [0.70, 0.16, 0.10];
frame_color = [0.90, 0.62, 0.18];
axle_color = [0.45, 0.48, 0.52];

$fn = 64;

// ---- directions ------------------------------------------------------------------------------------------------

golden = (1 + sqrt(5)) / 2;

// The twelve corners of an icosahedron as unit vectors; each is followed by its opposite. Its edges' midpoints lie
// on the axes x, y and z, which is why the axles can carry the frame.
corners = [for (s = [1, -1], c = [[0, 1, s * golden], [s * golden, 0, 1], [1, s * golden, 0]], side = [1, -1])
    side * c / norm(c)];
edge = 2 / norm([1, golden]);
edges = [for (a = [0:11], b = [a:11]) if (abs(norm(corners[a] - corners[b]) - edge) < 0.01) [corners[a], corners[b]]];
axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

// Point i of n spread evenly over the unit sphere (Fibonacci lattice), from the top down.
function spread(i, n) =
    let (z = 1 - (2 * i + 1) / n, turn = 360 * i / golden, r = sqrt(1 - z * z)) [r * cos(turn), r * sin(turn), z];

// ---- how many of each part -------------------------------------------------------------------------------------

// Parts come in this order until the ball has spent its n primitives; dimples take the rest.
shell_parts = 2;
parts = [6, 3, 6, 12, 30, 12, 1];  // ports, axles, knobs, joints, struts, rims, hub
function sum(list, n) = n == 0 ? 0 : list[n - 1] + sum(list, n - 1);
function spent(n, k) = max(0, min(parts[k], n - shell_parts - sum(parts, k)));
function dimples(n) = max(0, n - shell_parts - sum(parts, len(parts)));

balls = ceil(halfspaces / most_per_ball);
most_dimples = dimples(ceil(halfspaces / balls));

assert(halfspaces >= balls * shell_parts, "a ball needs two primitives at least");

// ---- dimples ---------------------------------------------------------------------------------------------------

dimple_r = min(1.2, 1.2 * ball_r / sqrt(max(1, most_dimples)));
from_port = asin((rim_r + dimple_r) / ball_r);  // least angle between the centres of a dimple and of a port
from_axle = asin((axle_r + dimple_r) / ball_r);
function undrilled(p) = max([for (c = corners) c * p]) < cos(from_port) && max([for (x = p) abs(x)]) < cos(from_axle);
undrilled_share = 1 - 6 * (1 - cos(from_port)) - 3 * (1 - cos(from_axle));  // of the sphere

// The first n undrilled points of a lattice of `tried` or more.
function dimple_sites(n, tried) =
    let (found = [for (i = [0:1:tried - 1]) let (p = spread(i, tried)) if (undrilled(p)) p])
    len(found) < n ? dimple_sites(n, tried + 1) : [for (i = [0:1:n - 1]) found[i]];
sites = dimple_sites(most_dimples, ceil(most_dimples / undrilled_share));

// ---- parts -----------------------------------------------------------------------------------------------------

// A rod of radius r between two points.
module rod(from, to, r) {
    way = to - from;
    translate(from) rotate([0, acos(way.z / norm(way)), atan2(way.y, way.x)]) cylinder(h = norm(way), r = r);
}

module shell(n, sizes) {
    difference() {
        color(shell_color) sphere(ball_r);
        color(cavity_color) sphere(ball_r - wall);
        color(shell_color) for (i = [0:1:spent(n, 0) - 1])
            rod(-1.2 * ball_r * corners[2 * i], 1.2 * ball_r * corners[2 * i], port_r * sizes[i]);
        color(frame_color) for (i = [0:1:spent(n, 5) - 1])
            rod((ball_r - rim_depth) * corners[i], 1.1 * ball_r * corners[i], rim_r);
        color(dimple_color) for (i = [0:1:dimples(n) - 1])
            translate((ball_r + 0.3 * dimple_r) * sites[i]) sphere(dimple_r * sizes[6 + i]);
    }
}

module frame(n) {
    for (i = [0:1:spent(n, 3) - 1]) translate(frame_r * corners[i]) sphere(1.25);
    for (i = [0:1:spent(n, 4) - 1]) rod(frame_r * edges[i][0], frame_r * edges[i][1], 0.5);
}

module axles(n) {
    for (i = [0:1:spent(n, 1) - 1]) rod(-axle_end * axes[i], axle_end * axes[i], axle_r - 0.02 * i);
    for (i = [0:1:spent(n, 2) - 1]) translate(axle_end * (i < 3 ? axes[i] : -axes[i - 3])) sphere(1);
    if (spent(n, 6) == 1) sphere(2);
}

module ball(n, seed) {
    shell(n, rands(1 - vary, 1 + vary, 6 + dimples(n), seed));
    color(frame_color) frame(n);
    color(axle_color) axles(n);
}

// ---- the model -------------------------------------------------------------------------------------------------

seeds = rands(0, 1e6, balls, seed);
side = ceil(pow(balls, 1 / 3) - 1e-9);
for (i = is_undef(made) ? [0:balls - 1] : made)
    translate(pitch * [i % side, floor(i / side) % side, floor(i / (side * side))])
        ball(floor((halfspaces + i) / balls), seeds[i]);
