// SPDX-License-Identifier: GPL-2.0-or-later
// Stands in for <plib/sg.h>: all that TORCS' car.h takes from it. The real one brings the OpenGL development packages.
#pragma once
typedef float sgFloat;
typedef sgFloat sgVec2[2];
typedef sgFloat sgVec3[3];
typedef sgFloat sgMat4[4][4];
