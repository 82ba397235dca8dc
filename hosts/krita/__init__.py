"""Texloom in Krita 5. `hosts/build.py` makes the plug-in, with ``texloom_client.py`` beside this file."""

from krita import Krita

from .extension import Texloom

Krita.instance().addExtension(Texloom(Krita.instance()))
