"""Videos, images and an interactive viewer of policies. Import from the modules."""
