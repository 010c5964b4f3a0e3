"""The tissue under a stroke in three dimensions: lumps that end across the stroke, and true tactile
images."""
