"""Our schemes beside POV-Ray and Embree: the same pictures, one thread and all."""
