// An NGK spark plug (M14, 19 mm reach, 20.8 mm hexagon) and a tray of them standing side by side. Blocks, cones,
// cylinders and tori only. Millimetres; z = 0 is the seat of the shell, the terminal points up.
//
// No two visible faces share a plane: a part that joins another overlaps it, and stands a little proud of it or short.

most_per_plug = 94;      // primitives in one plug, at most
spacing = 24.5;          // between neighbouring plugs in the tray

hex_flats = 20.8;        // across the flats of the hexagon
hex_z = [5.5, 15];       // its bottom and top
thread_r = 7;            // outside of the thread: M14
reach = 19;              // from the seat to the end of the shell
insulator_r = 5.4;
rib_z = 39.5;            // lowest of the insulator's ribs
rib_pitch = 2.25;
spark_z = -21;           // end of the centre electrode
gap = 0.9;               // from there to the ground electrode

steel = [0.60, 0.62, 0.66];
nickel = [0.45, 0.45, 0.47];
copper = [0.80, 0.45, 0.25];
brass = [0.85, 0.66, 0.30];
ceramic = [0.93, 0.92, 0.88];
ink = [0.75, 0.08, 0.10];

// ---- how many of each part -------------------------------------------------------------------------------------

// A plug of n primitives has a core of 10. A larger one has the ribs, then the fittings (bevels, bores, gasket, strap,
// ...), then the lettering. Thread crests and roots take the rest: 30 of them, 15 turns, in a plug of 94.
function ribbed(n) = n >= 30;
function fitted(n) = n >= 60;
function lettered(n) = n >= 75;
function threads(n) = n - 10 - (ribbed(n) ? 10 : 0) - (fitted(n) ? 32 : 0) - (lettered(n) ? 12 : 0);

// ---- shapes ----------------------------------------------------------------------------------------------------

module torus(z, R, r) { translate([0, 0, z]) rotate_extrude() translate([R, 0]) circle(r = r); }
module rod(z, r) { translate([0, 0, z[0]]) cylinder(h = z[1] - z[0], r = r); }
module cone(z, r) { translate([0, 0, z[0]]) cylinder(h = z[1] - z[0], r1 = r[0], r2 = r[1]); }
module block(centre, size) { translate(centre) cube(size, center = true); }

// ---- the steel shell -------------------------------------------------------------------------------------------

module hexagon(n) {
    middle = [0, 0, (hex_z[0] + hex_z[1]) / 2];
    height = hex_z[1] - hex_z[0];
    difference() {
        intersection() {  // three slabs, of which the first alone makes the top and the bottom
            block(middle, [hex_flats, 30, height]);
            rotate(60) block(middle, [hex_flats, 30, height + 2]);
            rotate(120) block(middle, [hex_flats, 30, height + 4]);
            if (fitted(n)) {  // bevels of 30 degrees, top and bottom
                intersection() {
                    cone([hex_z[0] - 2, hex_z[1] + 1], [10.2 + 11.5 * sqrt(3), 10.2 - sqrt(3)]);
                    cone([hex_z[0] - 1, hex_z[1] + 2], [10.2 - sqrt(3), 10.2 + 11.5 * sqrt(3)]);
                }
            }
        }
        if (fitted(n)) torus(middle.z, 12.3, 0.9);  // the maker's groove around the six corners
    }
}

module crests(turns, pitch) {
    for (i = [0:1:turns - 1]) torus(-0.2 - (i + 0.5) * pitch, thread_r - 0.48 * min(pitch, 1.6), 0.48 * min(pitch, 1.6));
}

module roots(turns, pitch) {
    for (i = [0:1:turns - 1]) torus(-0.2 - (i + 1) * pitch, thread_r - 0.2, 0.4 * min(pitch, 1.6));
}

module shell(n) {
    pitch = (reach - 0.25) / max(1, ceil(threads(n) / 2));
    difference() {
        union() {
            hexagon(n);
            rod([1.2, 18], 9.3);                     // collar, below and above the hexagon
            rod([0.6 - reach, 2], thread_r - 0.6);   // carries the thread
            crests(ceil(threads(n) / 2), pitch);
            if (fitted(n)) {
                cone([0, 1.6], [8.4, 9.2]);                      // seat
                cone([-reach, 1.2 - reach], [5.6, 6.35]);        // lead-in of the thread
                cone([17.5, 19.5], [9.1, 7]);                    // crimped over the insulator
                torus(19.3, 6.7, 0.5);
            }
        }
        roots(floor(threads(n) / 2), pitch);
        if (fitted(n)) {
            torus(4.6, 10, 1.1);                                 // undercut below the hexagon
            rod([-reach - 0.5, -9], 4.6);                        // clearance around the insulator's nose
            cone([-9.5, -6], [4.75, 3.4]);
        }
    }
}

module gasket() {
    torus(-0.55, 7.9, 0.65);
    torus(-1.45, 7.85, 0.55);
}

// ---- the ceramic insulator -------------------------------------------------------------------------------------

module insulator(n) {
    ribs = ribbed(n) ? 5 : 0;
    difference() {
        union() {
            rod([10, 50], insulator_r);
            cone([1.2 - reach, -7], [2.3, 4.3]);                 // nose
            for (i = [0:1:ribs - 1]) torus(rib_z + i * rib_pitch, insulator_r - 0.1, 0.8);
            if (fitted(n)) {
                torus(1.3 - reach, 1.8, 0.5);                    // rounds the nose
                cone([18.5, 22.5], [7.2, 5.2]);                  // shoulder
                cone([49.8, 53], [5.2, 3.6]);
                torus(52.8, 3.1, 0.6);                           // rounds the top
            }
        }
        for (i = [0:1:ribs - 1]) torus(rib_z + (i + 0.5) * rib_pitch, insulator_r + 0.5, 0.6);
    }
}

// The strokes of N, G and K, from and to: [along, up] in millimetres. Letters are 4 wide and 7 high.
letters = [
    [[[0, 0], [0, 6]], [[0.2, 5.7], [2.8, 0.3]], [[3, 0], [3, 6]]],
    [[[3, 6], [0, 6]], [[0, 6], [0, 0]], [[0, 0], [3, 0]], [[3, 0], [3, 2.7]], [[3, 2.7], [1.6, 2.7]]],
    [[[0, 0], [0, 6]], [[0.2, 2.4], [2.8, 5.8]], [[0.9, 3.5], [2.8, 0.2]]],
];

// A stroke stops short of a square end, so that no end lies in the side of the stroke that it meets.
module stroke(from, to) {
    way = to - from;
    translate([(from.x + to.x) / 2, 0, (from.y + to.y) / 2]) rotate([0, -atan2(way.y, way.x), 0])
        cube([norm(way) + 0.9, 2.6, 1.1], center = true);
}

// Raised print that reads up the insulator, on the side that faces -y.
module lettering() {
    intersection() {
        rod([23, 39], insulator_r + 0.12);
        translate([0, -4.8, 24.8]) rotate([0, -90, 0]) translate([0, 0, -3])
            for (i = [0:2]) for (s = letters[i]) translate([4.6 * i, 0, 0]) stroke(s[0], s[1]);
    }
}

module bands() {
    rod([23, 23.6], insulator_r + 0.06);
    rod([37.5, 38.1], insulator_r + 0.06);
}

// ---- terminal and electrodes -----------------------------------------------------------------------------------

module terminal(n) {
    difference() {
        union() {
            rod([49, 61], 2.7);
            if (fitted(n)) {
                torus(53.5, 2.8, 0.6);
                rod([53.9, 55], 3.4);
                cone([54.8, 56.4], [3.3, 2.6]);
                cone([60.6, 62], [2.6, 1.8]);
            }
        }
        if (fitted(n)) {
            torus(57.9, 3.1, 0.8);  // where the cap snaps in
            rod([58, 63], 0.9);
        }
    }
}

module centre_electrode(n) {
    rod([-19.6, -5], 1.25);
    if (fitted(n)) {
        cone([0.4 + spark_z, -19.4], [0.6, 1.2]);
        rod([spark_z, spark_z + 0.6], 0.4);
    }
}

// A strap welded to the end of the shell and bent under the centre electrode.
module ground_electrode(n) {
    top = spark_z - gap;
    block([5.2, 0, (top - 17.5) / 2], [1.4, 2.8, -17.5 - top]);
    if (fitted(n)) {
        block([5.2, 0, 0.4 - reach], [1.8, 3.2, 1.2]);                                  // weld
        translate([4.6, 0, top]) rotate([90, 0, 0]) cylinder(h = 2.9, r = 1.45, center = true);  // bend
        rod([top - 0.2, top + 0.2], 0.6);                                               // pad
        difference() {
            block([1.5, 0, top - 0.65], [6.2, 2.7, 1.4]);
            for (side = [-1, 1]) translate([-1.6, side * 1.35, top]) rotate(45) cube([1, 1, 4], center = true);
        }
    }
}

// ---- a plug, and a tray of plugs -------------------------------------------------------------------------------

// n primitives, 10 or more.
module plug(n) {
    color(steel) shell(n);
    color(ceramic) insulator(n);
    color(brass) terminal(n);
    color(nickel) centre_electrode(n);
    color(nickel) ground_electrode(n);
    if (fitted(n)) color(copper) gasket();
    if (fitted(n)) color(ink) bands();
    if (lettered(n)) color(ink) lettering();
}

function plugs(halfspaces) = ceil(halfspaces / most_per_plug);
function columns(halfspaces) = ceil(sqrt(plugs(halfspaces) * 6 / 7));
function rows(halfspaces) = ceil(plugs(halfspaces) / columns(halfspaces));
row_spacing = spacing * sqrt(3) / 2;  // every other row stands in the gaps of its neighbours
function tray_size(halfspaces) =      // between the outermost axes
    [spacing * (columns(halfspaces) - 0.5), row_spacing * (rows(halfspaces) - 1), 0];

// Plugs in staggered rows around the z axis. The seed draws how far each is turned, by `turn` degrees at most. `made`
// lists the numbers of those to make.
module tray(halfspaces, turn, seed, made) {
    assert(halfspaces >= 10, "a plug needs ten primitives at least");
    count = plugs(halfspaces);
    turns = rands(-turn, turn, count, seed);
    for (i = is_undef(made) ? [0:count - 1] : made) {
        row = floor(i / columns(halfspaces));
        column = i % columns(halfspaces) + (row % 2) / 2;
        translate([spacing * column, row_spacing * row, 0] - tray_size(halfspaces) / 2)
            rotate(turns[i]) plug(floor((halfspaces + i) / count));
    }
}
