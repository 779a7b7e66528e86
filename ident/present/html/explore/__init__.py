"""An arm as a page with sliders, which computes by itself."""
