"""Kinds of photographs from outside: light, skins, projectors and sensors nothing was built on.

`MENDING` may be looked at while the package is changed; `HELD` judges, on fresh seeds, and is
looked at last.
"""

from __future__ import annotations

import outside_light as light
import outside_projectors as projectors
import outside_sensors as sensors
import outside_shapes as shapes
import outside_skins as skins
import outside_things as things
from outside_panels import Kind, of_sensor, plain

MENDING: dict[str, Kind] = {
    'plain': plain,
    'dim_corners': light.dim_corners,
    'lens_dirt': of_sensor(lens=sensors.dirt_on_glass),
    'wet': skins.wet,
    'corner_glossy': shapes.corner,
    'carbon': skins.carbon,
    'blinds': light.blinds,
    'mains_flicker': light.mains_flicker,
    'bad_lines': of_sensor(codec=sensors.bad_lines),
    'video': of_sensor(codec=sensors.video),
    's_curve': of_sensor(curve=sensors.s_curve),
    'tilted_focus': of_sensor(lens=sensors.tilted_focus),
    'leading_edge': shapes.leading_edge,
    'cable': shapes.cable,
    'fasteners': skins.fasteners,
    'at_the_rim': shapes.at_the_rim,
    'enormous': shapes.enormous,
    'chequers': skins.chequers,
    'laser_line': light.laser_line,
    'focused_aslant': projectors.focused_aslant,
    'dusty_projector': projectors.dusty_projector,
    'off_gamma': projectors.off_gamma,
    'chromatic': projectors.chromatic,
    'denoised': of_sensor(codec=sensors.denoised),
    'tone_mapped': of_sensor(codec=sensors.tone_mapped),
    'fixed_pattern': of_sensor(curve=sensors.fixed_pattern),
    'turned': of_sensor(codec=sensors.turned),
    'rolling': things.rolling,
    'circled': things.circled,
    'speed_tape': things.speed_tape,
    'polished': skins.polished,
    'insects': skins.insects,
    'honeycomb': shapes.honeycomb,
    'lapped_dent': things.lapped_dent,
    'oil_can': shapes.oil_can,
    'behind': shapes.behind,
    'net': things.net,
    'steep_crease': shapes.steep_crease,
    'far_stripes': light.far_stripes,
}

HELD: dict[str, Kind] = {
    'glass_drops': of_sensor(lens=sensors.drops_on_glass),
    'frosted': skins.frosted,
    'corner_matt': lambda rng: shapes.corner(rng, matt=True),
    'brushed': skins.brushed,
    'window': shapes.window,
    'fog': of_sensor(lens=sensors.fog(0.5, 0.15)),
    'other_projector': light.other_projector,
    'strobe': light.strobe,
    'colour_wheel': light.colour_wheel,
    'smear_across': of_sensor(lens=sensors.smear(5, upright=False)),
    'smear_along': of_sensor(lens=sensors.smear(9, upright=True)),
    'steep': shapes.steep,
    'hand': shapes.hand,
    'bar_code': skins.bar_code,
    'rippled': shapes.rippled,
    'bead': shapes.bead,
    'fluttering': shapes.fluttering,
    'coloured': skins.coloured,
    'flare': of_sensor(lens=sensors.flare),
    'ghost': projectors.ghost,
    'dithered': projectors.dithered,
    'pulsed': projectors.pulsed,
    'headlamp': light.headlamp,
    'enlarged': of_sensor(codec=sensors.enlarged),
    'gain_jump': of_sensor(curve=sensors.gain_jump),
    'strap': of_sensor(lens=sensors.strap),
    'snowflakes': of_sensor(lens=sensors.snowflakes),
    'mirrored': of_sensor(codec=sensors.mirrored),
    'shaken': things.shaken,
    'wavy_livery': skins.wavy_livery,
    'pearl': skins.pearl,
    'stickers': things.stickers,
    'door_seal': things.door_seal,
    'static_port': things.static_port,
    'antenna': things.antenna,
    'scalloped': things.scalloped,
    'off_aircraft': shapes.off_aircraft,
    'frame_shadow': shapes.frame_shadow,
    'rivets_in_dent': things.rivets_in_dent,
    'sealed_dent': things.sealed_dent,
}
