// A tray of NGK spark plugs: 42 of them at the default size. Millimetres.

use <plug.scad>

halfspaces = 3948;  // primitives in all: 94 a plug
turn = 35;          // degrees that a plug is turned in the tray, at most
seed = 1;           // draws those turns
made = undef;       // numbers of the plugs to make: all, or a list

$fn = 64;

tray(halfspaces, turn, seed, made);
