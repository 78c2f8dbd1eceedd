// Roters' taper plunger magnet, half section (x = r, y = z) in inches; the plunger is drawn in by s.
// H. C. Roters, Electromagnetic Devices, ch. IX fig. 7; coordinates of FEMM's example roters1b (femm.info/wiki/RotersExample).
SetFactory("OpenCASCADE");
s = 0.5;
Point(1) = {0.6875, 0, 0};          Point(2) = {0.8125, 0, 0};             Point(3) = {1.0391626, 1.6127880, 0};
Point(4) = {1.75, 1.6875, 0};       Point(5) = {1.75, 5.8125, 0};          Point(6) = {0.9321766, 5.8984567, 0};
Point(7) = {0.8125, 6.75, 0};       Point(8) = {0.6875, 6.75, 0};          Point(9) = {0.6875, 5.5, 0};
Point(10) = {1.5625, 5.5, 0};       Point(11) = {1.5625, 2, 0};            Point(12) = {0.6875, 2, 0};
For k In {1:11}
  Line(k) = {k, k + 1};
EndFor
Line(12) = {12, 1};
Curve Loop(1) = {1:12};
Plane Surface(1) = {1};
Rectangle(2) = {0.6875, 2, 0, 0.875, 3.5};
Point(21) = {0, -0.5 - s, 0};       Point(22) = {0.65625, -0.5 - s, 0};    Point(23) = {0.65625, 5.4375 - s, 0};
Point(24) = {0.46875, 6.75 - s, 0}; Point(25) = {0, 6.75 - s, 0};
For k In {21:24}
  Line(k) = {k, k + 1};
EndFor
Line(25) = {25, 21};
Curve Loop(3) = {21:25};
Plane Surface(3) = {3};
Physical Surface("shell") = {1};
Physical Surface("coil") = {2};
Physical Surface("plunger") = {3};
