"""The flows that the page offers."""

from __future__ import annotations

from texloom.pipelines.flow.model import Reference
from texloom.pipelines.studio.material_offers import MATERIAL_SYNTHESIS, PHOTO_MATERIAL
from texloom.pipelines.studio.messages.catalogue import Picker, ResultPicture, SeveralPictures
from texloom.pipelines.studio.offer import Offer, angles, curve, number, setting, switch, tiles
from texloom.stages.synthesis.endless.triangle_grid import SHARE

WEIGHTS = "sheet.weights"
"""the param of which a recipe has a number for each of several pictures"""
WAY = ("suits", "way")
"""a step that chooses how a flow goes on, or refuses, and the param that decides instead"""

STROKES = "direction.stroke_radius"
"""the param of how far from a line on a mesh that leads, px of the picture of all lines"""

_TEXTURE = ResultPicture(file="texture.png", name="Texture")

OFFERS = {
    "self_tuning": Offer("Most materials; structures stay connected"),
    "materials": Offer("All maps of a material, from one correspondence"),
    "material_synthesis": MATERIAL_SYNTHESIS,
    "photo_material": PHOTO_MATERIAL,
    "near_regular": Offer("Tiles, grids and weaves"),
    "quilting": Offer("Large irregular pieces, in a second or two"),
    "graph_cut": Offer("Large irregular pieces, cut along the best seams"),
    "patch_based": Offer("Grain, soil and noise, quickly"),
    "per_pixel": Offer("Grain, soil and noise, pixel by pixel"),
    "remix": Offer(
        "One texture of several pictures",
        several=SeveralPictures(source="exemplars", least=2, is_ordered=False, ends=("", ""), weights=WEIGHTS),
        controls=(number("match_tone", "Match tones", 0, 1, 0.0, ("as they are", "all alike")),),
        views=(_TEXTURE, ResultPicture(file="origin.png", name="Which picture")),
    ),
    "mix": Offer(
        "From one picture to the next, in patches of whole elements",
        several=SeveralPictures(source="exemplars", least=2, ends=("where it begins", "where it ends")),
        others={"map": "Map"},
        painted={"map": ("the first", "the last")},
        choices=(
            Picker(
                label="Border",
                settings=(
                    setting("patches of either"),
                    setting("one clear line", patchiness=0.0, gradual=False),
                    setting("patches everywhere", patchiness=1.0),
                    setting("small islands", patchiness=1.0, **{"mixture.patch": 24}),
                ),
            ),
            Picker(
                label="Direction",
                settings=(setting("left to right"), *angles("mixture.angle")[1:]),
                without="map",
            ),
        ),
        controls=(
            number("patchiness", "Patches", 0, 1, 0.6, ("one border", "wherever they mix")),
            switch("gradual", "Colours change gradually", True),
            number("match_tone", "Match tones", 0, 1, 0.0, ("as they are", "all alike")),
            number("weight", "Hold to the map", 0.3, 3, 1.0, ("freely", "closely")),
        ),
        views=(_TEXTURE, ResultPicture(file="origin.png", name="Which picture")),
        lengths={"mixture.patch": 4},
    ),
    "grow": Offer(
        "What ages or changes from place to place, its trend over all of the result",
        others={"target": "Trend of the result", "progression": "Trend of the exemplar"},
        painted={"target": ("as it begins", "as it ends")},
        choices=(
            Picker(
                label="Trend",
                settings=(
                    curve("as it is"),
                    curve("reversed", 1.0, 0.0),
                    curve("there and back", 0.0, 1.0, 0.0),
                    curve("only the later half", 0.5, 1.0),
                    curve("only the earlier half", 0.0, 0.5),
                    curve("late, then all at once", 0.0, 0.1, 0.3, 1.0),
                    curve("soon, then for long", 0.0, 0.7, 0.9, 1.0),
                ),
            ),
            Picker(label="Direction", settings=(setting("the picture's own"), *angles("angle")), without="target"),
        ),
        controls=(
            number("weight", "Hold to the trend", 0.3, 3, 1.0, ("freely", "closely")),
            number("direction", "Hold to directions", 0, 3, 1.0, ("freely", "closely")),
        ),
        views=(
            _TEXTURE,
            ResultPicture(file="progression.png", name="Trend found"),
            ResultPicture(file="target.png", name="Trend laid over"),
        ),
    ),
    "restyle": Offer(
        "Another picture, made of the exemplar",
        others={"picture": "Picture that it is laid over"},
        choices=(
            Picker(
                label="Style",
                settings=(
                    setting("as the picture"),
                    setting("more texture", weight=0.3, detail=4.0),
                    setting("fine drawing", weight=1.3, detail=1.0),
                    setting("flat signs and letters", weight=1.3, detail=0.0),
                ),
            ),
        ),
        controls=(
            number("weight", "Follow the picture", 0.3, 3, 1.0, ("freely", "closely")),
            number("detail", "Coarseness", 0, 16, 2.0, ("fine", "coarse")),
        ),
    ),
    "vary": Offer(
        "Versions as tiles that fit in any order",
        choices=(
            Picker(
                label="Versions",
                settings=(
                    setting("8"),
                    setting("2", "2x1", variants="2x1"),
                    setting("4", "2x2", variants="2x2"),
                    setting("6", "3x2", variants="3x2"),
                    setting("10", "5x2", variants="5x2"),
                    setting("16", "4x4", variants="4x4"),
                ),
            ),
            tiles(64, 128, 256, 512, 1024),
        ),
        controls=(number("strength", "Difference", 0, 1, 1.0, ("other details", "all new")),),
        views=(
            ResultPicture(file="preview.png", name="Laid at random"),
            ResultPicture(file="texture.png", name="Versions"),
        ),
        is_texture=False,
        lengths={"tile": 48},
    ),
    "transition_tiles": Offer(
        "Terrain tiles between two or three materials, for Godot, Unity and Tiled",
        several=SeveralPictures(source="exemplars", least=2, most=3, ends=("the ground", "on top")),
        choices=(
            tiles(64, 128, 256, 512),
            Picker(
                label="Versions",
                settings=(
                    setting("1 of each"),
                    setting("2 of each", variants="2x1"),
                    setting("4 of each", variants="2x2"),
                ),
            ),
            Picker(label="Sets", settings=(setting("corners, paths"), setting("corners, sooner", sets="corners"))),
        ),
        controls=(
            number("waves", "Borders", 0, 0.5, 0.3, ("straight", "wandering")),
            number("match_tone", "Match tones", 0, 1, 0.0, ("as they are", "all alike")),
        ),
        views=(
            ResultPicture(file="preview.png", name="Map"),
            ResultPicture(file="corners.png", name="Corners"),
            ResultPicture(file="blob.png", name="Blob"),
            ResultPicture(file="edges_preview.png", name="Paths"),
            ResultPicture(file="edges.png", name="Path tiles"),
        ),
        is_texture=False,
        lengths={"tile": 48},
    ),
    "endless": Offer(
        "A plane without end for engines: textures and shaders; of noise, or of the cells of bricks and tiles",
        choices=(
            Picker(
                label="Way",
                settings=(setting("as suits"), setting("blended", way="noise"), setting("cells", way="cells")),
            ),
            Picker(
                label="Look",
                settings=(
                    setting("as published"),
                    setting("crisp", sharpness=4.0),
                    setting("large features", tile=0.5, sharpness=4.0),
                    setting("well mixed", tile=0.2),
                ),
            ),
        ),
        controls=(
            number("tile", "Size of pieces", 0.05, 1, round(SHARE, 3), ("mixed", "whole features")),
            number("sharpness", "Sharpness", 1, 16, 2.0, ("soft", "crisp")),
            number("rotation", "Turn hexagons", 0, 180, 0.0, ("not", "any way")),
            switch("accept", "Also if it has structure", False),
        ),
        views=(
            ResultPicture(file="preview.png", name="Plane"),
            ResultPicture(file="cells_preview.png", name="Plane of cells"),
            ResultPicture(file="cells.png", name="Cells"),
            ResultPicture(file="texture.png", name="Tile"),
            ResultPicture(file="hex.png", name="Hexagons"),
        ),
        is_texture=False,
        ways={"noise": "preview.png", "cells": "cells_preview.png"},
    ),
    "rectify_pieces": Offer("Pieces of the picture that are laid, made coherent", layer="collage"),
    "per_pixel_control": Offer("What is where follows a map that is painted", layer="paint"),
    "on_mesh": Offer(
        "Along lines and by values that are drawn on a mesh", layer="mesh", is_texture=False, lengths={STROKES: 2}
    ),
    "photo_flattening": Offer(
        "A surface that is placed by hand, laid flat",
        layer="surfaces",
        draft=Reference("laid_flat_texture", "image"),
    ),
    "photo_to_texture": Offer("A surface that is placed by hand, synthesised where it is", layer="surfaces"),
    "photo_completion": Offer("A hole that is filled as its surface lies", layer="surfaces", is_texture=False),
    "photo_to_photo": Offer("A hole of another photograph that is covered", layer="surfaces", is_texture=False),
}  # fmt: skip
"""the flows that the page offers"""
