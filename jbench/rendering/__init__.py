"""Videos, pictures and a window of any policy. Import what you need from the modules."""
