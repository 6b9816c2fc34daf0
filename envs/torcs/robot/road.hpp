// SPDX-License-Identifier: GPL-2.0-or-later
// The road as the car sees it. Lengths in m, angles in rad, to the left positive; "to_middle" is the distance from
// the road's middle line, "along" the distance from the start line, measured on the middle line.
#pragma once
#include <cmath>
#include <cstring>
#include <robottools.h>
#include <track.h>

namespace road {

inline double wrapped(double angle) { return std::remainder(angle, 2.0 * M_PI); }

// How far into its segment a place is, on the middle line.
inline double into_segment(const tTrkLocPos &place) {
    return place.seg->type == TR_STR ? place.toStart : place.toStart * place.seg->radius;
}

inline double along(const tTrkLocPos &place) { return place.seg->lgfromstart + into_segment(place); }

// A place on a segment, or on one after or before it where `into` lies outside.
inline tTrkLocPos place_at(tTrackSeg *segment, double into, double to_middle = 0.0) {
    for (; into >= segment->length; segment = segment->next) into -= segment->length;
    while (into < 0.0) {
        segment = segment->prev;
        into += segment->length;
    }
    tTrkLocPos place;
    std::memset(&place, 0, sizeof place);
    place.seg = segment;
    place.type = TR_LPOS_MAIN;
    place.toStart = segment->type == TR_STR ? into : into / segment->radius;
    place.toMiddle = to_middle;
    place.toRight = segment->width / 2 + to_middle;
    place.toLeft = segment->width / 2 - to_middle;
    return place;
}

inline tTrackSeg *first_segment(const tTrack *track) { return track->seg->next; }  // track->seg is the last one

// Curvature (1/m) of the middle line.
inline double curvature(const tTrackSeg *segment) {
    if (segment->type == TR_STR) return 0.0;
    return (segment->type == TR_LFT ? 1.0 : -1.0) / segment->radius;
}

// Free road from a place on in some direction, at most `farthest`: steps of 2 m, then bisection to 3 cm.
inline double ray(const tTrkLocPos &from, double x, double y, double direction, double farthest) {
    const double dx = std::cos(direction), dy = std::sin(direction);
    auto on_road = [&](double distance, tTrackSeg **segment) {  // searches from *segment on, and leaves where it ended
        tTrkLocPos place;
        RtTrackGlobal2Local(*segment, x + distance * dx, y + distance * dy, &place, TR_LPOS_MAIN);
        *segment = place.seg;
        return std::fabs(place.toMiddle) <= place.seg->width / 2;
    };
    tTrackSeg *segment = from.seg;
    if (std::fabs(from.toMiddle) > segment->width / 2) return 0.0;
    for (double free = 0.0; free < farthest; free += 2.0) {
        tTrackSeg *reached = segment;
        if (on_road(free + 2.0, &reached)) {
            segment = reached;
            continue;
        }
        double blocked = free + 2.0;
        for (int halving = 0; halving < 6; ++halving) {
            const double middle = 0.5 * (free + blocked);
            reached = segment;
            (on_road(middle, &reached) ? free : blocked) = middle;
        }
        return free;
    }
    return farthest;
}

}  // namespace road
