// The tray of spark plugs, cut by one long bore that runs along the rows through every plug. Millimetres.

use <plug.scad>

halfspaces = 3949;    // primitives in all: the bore and, in the default size, 94 for each of 42 plugs
turn = 35;            // degrees that a plug is turned in the tray, at most
seed = 1;             // draws those turns

bore_low = 17;        // height of the bore's wall at the middle of the tray: through shell and insulator
bore_high = 56;       // and at the outermost rows: through the terminals
bore_margin = 20;     // how far it reaches past the outermost plugs, from their axes
bore_color = [0.88, 0.36, 0.16];

$fn = 64;

plug_halfspaces = halfspaces - 1;
size = tray_size(plug_halfspaces);
sag = bore_high - bore_low;
bore_r = (pow(size.y / 2, 2) + sag * sag) / (2 * sag);  // of the circle through the low point and both high ones

difference() {
    tray(plug_halfspaces, turn, seed);
    color(bore_color) translate([0, 0, bore_low + bore_r]) rotate([0, 90, 0])
        cylinder(h = size.x + 2 * bore_margin, r = bore_r, center = true);
}
