"""Why a real machine differs from its model: where, which effect, how far the gap shrinks."""
