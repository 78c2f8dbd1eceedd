// The simple solenoid of the Modelica Standard Library, half section (x = r, y = z) in mm; the armature x from the pole.
SetFactory("OpenCASCADE");
x = 2.5;
Point(1) = {0, 0, 0};     Point(2) = {15, 0, 0};       Point(3) = {15, 35, 0};    Point(4) = {5.65, 35, 0};
Point(5) = {5.65, 31.5, 0};   Point(6) = {13.5, 31.5, 0};    Point(7) = {13.5, 3.5, 0}; Point(8) = {5, 3.5, 0};
Point(9) = {5, 10, 0};    Point(10) = {0, 10, 0};
For k In {1:9}
  Line(k) = {k, k + 1};
EndFor
Line(10) = {10, 1};
Curve Loop(1) = {1:10};
Plane Surface(1) = {1};
Rectangle(2) = {5.65, 3.5, 0, 7.85, 28};
Rectangle(3) = {0, 10 + x, 0, 5, 26};
Physical Surface("yoke") = {1};
Physical Surface("coil") = {2};
Physical Surface("armature") = {3};
